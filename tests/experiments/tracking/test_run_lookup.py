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
from experiments.tracking.archive import without_folders, write_archive
from experiments.tracking.overview import top_runs
from experiments.tracking.run_lookup import find_family
from experiments.tracking.run_record import resumed_ids, resumed_tags

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


def test_jobs_that_an_earlier_sweep_had_finished_belong_to_a_later_one_as_well(
    counting_study: ModuleType, home: Path, store_template: Path, tmp_path: Path
) -> None:
    shutil.copy(store_template / "ctus.db", tmp_path / "other.db")
    assert main(["study=counting", "parts=[1,2]"]) == 0
    assert main(["study=counting", "parts=[1,2,3]", "resume=true"]) == 0
    assert main(["study=counting", "parts=[2,1,2]", "resume=true"]) == 0
    store = Store()
    tops = top_runs(store, None, ["counting"])
    expected = [["part 1", "part 2"], ["part 1", "part 2", "part 3"], ["part 1", "part 2"]]
    found = [sorted(run.name for run in find_family(top.run_id, store).jobs) for top in tops]
    assert sorted(found) == sorted(expected)
    assert sorted(top.finished for top in tops) == [2, 2, 3]
    assert all("part" in top.config for top in tops)
    assert main(["study=export_runs"]) == 0
    runs = home / "results" / "runs"
    of_archive = top_runs(OFF, runs, ["counting"])
    assert [(top.run_id, top.finished, top.config) for top in of_archive] == [
        (top.run_id, top.finished, without_folders(top.config)) for top in tops
    ]
    found = [sorted(run.name for run in find_family(top.run_id, OFF, runs).jobs) for top in of_archive]
    assert sorted(found) == sorted(expected)
    other = Store(uri=f"sqlite:///{tmp_path / 'other.db'}")
    assert main(["study=import_runs", f"tracking.uri={other.address}"]) == 0
    restored = [find_family(top.run_id, other) for top in top_runs(other, None, ["counting"])]
    assert sorted(sorted(run.name for run in each.jobs) for each in restored) == sorted(expected)


def test_the_jobs_of_a_sweep_that_still_runs_are_one_sweep_in_the_store_and_in_the_archive(
    counting_study: ModuleType, home: Path
) -> None:
    assert main(["study=counting", "parts=[1,2]"]) == 0
    store = Store()
    (before,) = top_runs(store, None, ["counting"])
    store.client().update_run(before.run_id, status="RUNNING")
    store.start("counting", "just begun", {})
    (top,) = top_runs(store, None, ["counting"])
    assert (top.run_id, top.status, top.finished) == (before.run_id, "RUNNING", 2)
    assert main(["study=export_runs"]) == 0
    (archived,) = top_runs(OFF, home / "results" / "runs", ["counting"])
    assert (archived.run_id, archived.status, archived.finished) == (before.run_id, "KILLED", 2)
    assert archived.config == without_folders(top.config)
    found = find_family(before.run_id, OFF, home / "results" / "runs")
    assert [run.name for run in found.jobs] == ["part 1", "part 2"]


def test_ids_of_many_resumed_jobs_are_kept_whole() -> None:
    many = [f"{number:032x}" for number in range(501)]
    tags = resumed_tags(many)
    assert max(map(len, tags.values())) <= 8000
    assert resumed_ids({**tags, "level": "sweep"}) == many
    assert resumed_tags([]) == {}
