"""Runs by the beginning of their id, with what lies below them, from a store and from an archive."""

from __future__ import annotations

import shutil
from pathlib import Path
from types import ModuleType

import pytest
from run_families import job

from experiments.cli import main
from experiments.errors import InputError
from experiments.tracking import ORIGIN_TAG, Store
from experiments.tracking.archive import write_archive
from experiments.tracking.run_lookup import find_family

OFF = Store(enabled=False)


def archive(folder: Path) -> Path:
    runs = [
        job("aa1", None),
        job("aa2", None, parent="aa1"),
        job("aa3", None, parent="aa2"),
        job("ab1", None),
    ]
    write_archive(runs, folder)
    return folder


def test_a_family_of_three_levels_has_its_jobs_and_what_sums_them_up(tmp_path: Path) -> None:
    found = find_family("aa1", OFF, archive(tmp_path))
    assert [run.run_id for run in found.jobs] == ["aa3"]
    assert [run.run_id for run in found.above] == ["aa1", "aa2"]
    assert [run.run_id for run in find_family("ab", OFF, tmp_path).jobs] == ["ab1"]


def test_an_unclear_and_an_unknown_id_are_refused_with_what_there_is(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"with which those of 3 runs begin: aa1 \(segmentation, run aa1\), aa2"
    ):
        find_family("aa", OFF, archive(tmp_path))
    with pytest.raises(InputError, match="found none that begins with 'zz'"):
        find_family("zz", OFF, tmp_path)
    with pytest.raises(InputError, match="runs: expected the id of a run, received none"):
        find_family(" ", OFF, tmp_path, "runs")


def test_runs_of_a_store_are_found_by_their_own_and_by_their_first_id(
    counting_study: ModuleType, home: Path, store_template: Path, tmp_path: Path
) -> None:
    shutil.copy(store_template / "ctus.db", tmp_path / "other.db")
    assert main(["study=counting"]) == 0
    store = Store()
    top = next(run.info.run_id for run in store.runs() if run.data.tags["ctus.kind"] == "sweep")
    found = find_family(top[:16], store)
    assert [run.name for run in found.jobs] == ["part 1", "part 2"]
    assert found.digests[found.jobs[0].run_id] == {"numbers": "abc"}
    assert main(["study=export_runs"]) == 0
    with pytest.raises(InputError, match=r"found none that begins with .*; .*runs has one: pass archive="):
        find_family(top, Store(uri=f"sqlite:///{tmp_path / 'other.db'}"))
    other = Store(uri=f"sqlite:///{tmp_path / 'other.db'}")
    assert main(["study=import_runs", f"tracking.uri={other.address}"]) == 0
    restored = next(run for run in other.runs() if run.data.tags.get(ORIGIN_TAG) == top)
    for reference in (top, restored.info.run_id):
        again = find_family(reference, other)
        assert again.run.run_id == top
        assert again.digests == found.digests
        assert [run.parent_id for run in again.jobs] == [top, top]
