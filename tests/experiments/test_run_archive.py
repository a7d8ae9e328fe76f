"""Runs as Parquet: what is exported here is the same run when restored elsewhere."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from types import ModuleType

import pandas as pd
import pytest

from experiments.cli import main
from experiments.errors import InputError
from experiments.run_archive import read_archive, without_folders, write_archive
from experiments.run_record import RunRecord
from experiments.tracking import ORIGIN_TAG, PARENT_TAG, Store


def record(run_id: str, parent_id: str | None = None, value: float = 1.0) -> RunRecord:
    history = pd.DataFrame(
        [("dsc", 0, 0.5, 111), ("dsc", 1, value, 222)], columns=["metric", "step", "value", "timestamp_ms"]
    )
    cases = pd.DataFrame({"case_id": ["a", "b"], "dsc": [0.1, float("inf")]})
    return RunRecord(
        run_id, "segmentation", f"run {run_id}", "FINISHED", 1000, 2000, parent_id, {"k": "v"}, {"fold": "0"},
        "fold: 0\n", history, cases,
    )  # fmt: skip


def test_write_then_read_gives_the_same_runs_parents_first(tmp_path: Path) -> None:
    assert write_archive([record("child", "parent"), record("parent")], tmp_path) == 2
    parent, child = read_archive(tmp_path)
    assert (parent.run_id, child.run_id, child.parent_id) == ("parent", "child", "parent")
    assert child.params == {"fold": "0"}
    assert child.tags == {"k": "v"}
    assert child.history["value"].tolist() == [0.5, 1.0]
    assert child.cases is not None
    assert child.cases["dsc"].tolist() == [0.1, float("inf")]


def test_a_second_export_replaces_its_runs_and_keeps_the_others(tmp_path: Path) -> None:
    write_archive([record("one"), record("two")], tmp_path)
    write_archive([record("two", value=0.9)], tmp_path)
    found = {run.run_id: run for run in read_archive(tmp_path)}
    assert set(found) == {"one", "two"}
    assert found["one"].history["value"].tolist() == [0.5, 1.0]
    assert found["two"].history["value"].tolist() == [0.5, 0.9]


@pytest.mark.parametrize(
    ("text", "shared"),
    [
        ("/data/usgra", ".../usgra"),
        ("of 3 in /home/a, 1 is new", "of 3 in .../a, 1 is new"),
        ("cache: '/srv/x/.cache/phantom'\nroot: /mnt/d/e\n", "cache: '.../phantom'\nroot: .../e\n"),
        ("[/a/b, /c/d/e]", "[.../b, .../e]"),
        ("results/runs", "results/runs"),
        ("https://host/a/b", "https://host/a/b"),
        ("sqlite:////srv/mlruns/ctus.db", "sqlite:///.../ctus.db"),
        ("1/2 of 3", "1/2 of 3"),
        ("/tmp", "/tmp"),
    ],
)
def test_folders_of_a_machine_are_cut_to_their_last_part(text: str, shared: str) -> None:
    assert without_folders(text) == shared


def test_an_archive_names_no_folder_of_the_machine(tmp_path: Path) -> None:
    named = dataclasses.replace(
        record("one"),
        params={"root": "/srv/data/usgra"},
        tags={"ctus.error": "no file /srv/data/x.png"},
        config="root: /srv/data/usgra\n",
    )
    write_archive([named], tmp_path)
    (found,) = read_archive(tmp_path)
    assert found.params == {"root": ".../usgra"}
    assert found.tags == {"ctus.error": "no file .../x.png"}
    assert found.config == "root: .../usgra\n"


def test_an_empty_folder_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"expected exported runs .* found none"):
        list(read_archive(tmp_path))


def test_runs_survive_the_store_they_were_made_in(
    counting_study: ModuleType,
    home: Path,
    store_template: Path,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    assert main(["study=counting"]) == 0
    assert main(["study=export_runs"]) == 0
    before = {run.info.run_id: run for run in Store().runs(["counting"])}
    fresh = tmp_path / "fresh"
    (fresh / "mlruns").mkdir(parents=True)
    (fresh / "mlruns" / "ctus.db").write_bytes((store_template / "ctus.db").read_bytes())
    monkeypatch.setenv("CTUS_HOME", str(fresh))

    assert main(["study=import_runs", f"archive={home / 'results' / 'runs'}"]) == 0
    assert main(["study=import_runs", f"archive={home / 'results' / 'runs'}"]) == 0  # adds nothing

    store = Store()
    after = {run.data.tags[ORIGIN_TAG]: run for run in store.runs(["counting"])}
    assert set(after) == set(before)
    for origin, run in after.items():
        old = before[origin]
        assert run.data.metrics == old.data.metrics
        assert run.data.params == old.data.params
        assert (run.info.status, run.info.start_time, run.info.end_time, run.info.run_name) == (
            old.info.status, old.info.start_time, old.info.end_time, old.info.run_name
        )  # fmt: skip
        if PARENT_TAG in old.data.tags:
            assert run.data.tags[PARENT_TAG] == after[old.data.tags[PARENT_TAG]].info.run_id
            cases = store.cases(run.info.run_id)
            assert cases is not None
            assert len(cases) == 3
    # A restored run counts as done: nothing is computed again.
    counting_study.calls.clear()
    assert main(["study=counting", "resume=true"]) == 0
    assert counting_study.calls == []
