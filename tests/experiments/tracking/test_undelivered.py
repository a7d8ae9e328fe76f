"""Runs that wait for the tracker: delivered in order and once, also by a process that was stopped in the middle."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
from filelock import FileLock
from mlflow.tracking import MlflowClient

from experiments.cli import main
from experiments.outcome import InputData
from experiments.tracking import ORIGIN_TAG, RunStart, RunWriter, Store
from experiments.tracking.run_record import read_run
from experiments.tracking.undelivered import deliver, keep, waiting, written_run


def unknown_run(name: str, folder: Path, parent: str | None = None, start_ms: int = 1000) -> RunWriter:
    """A finished run that no tracker has heard of."""
    run = RunWriter(
        None, f"{name}0000", beating=False, known=False,
        start=RunStart("work", name, parent, {"ctus.kind": "job"}, start_ms),
    )  # fmt: skip
    folder.mkdir()
    pd.DataFrame({"case_id": ["a"], "value": [0.5]}).to_parquet(folder / "cases.parquet")
    (folder / "metrics.json").write_text('{"value": 0.5, "lost": "nan"}')
    (folder / "note.txt").write_text("more")
    run.params({"setting": "x"})
    run.text("study: work\n", "config.yaml")
    run.history([{"loss": 1.0}, {"loss": 0.5}])
    run.inputs([InputData("numbers", "abc", "/some/folder")])
    run.files(folder, ["cases.parquet", "metrics.json", "note.txt"])
    run.end("FINISHED", start_ms + 500 + 10**15)
    return run


def test_a_run_that_no_tracker_knows_arrives_whole_and_once(home: Path, tmp_path: Path) -> None:
    run = unknown_run("one", tmp_path / "one")
    keep(run, Store().undelivered)
    assert deliver(Store()) == 1
    assert deliver(Store()) == 0
    (found,) = Store().runs(["work"])
    record, expected = read_run(Store(), found.info.run_id, "work"), written_run(run)
    assert (record.status, record.name, record.params) == ("FINISHED", "one", {"setting": "x"})
    assert record.history.sort_values(["metric", "step"])["value"].tolist() == [1.0, 0.5]
    assert record.inputs == expected.inputs
    assert record.metrics["value"] == expected.metrics["value"] == 0.5
    assert record.cases is not None and record.cases["value"].tolist() == [0.5]
    assert "note.txt" in {file.path for file in Store().client().list_artifacts(found.info.run_id)}


def test_a_delivery_that_is_stopped_anywhere_is_gone_on_with(
    home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    keep(unknown_run("one", tmp_path / "one"), Store().undelivered)
    for call in ("log_batch", "log_inputs", "log_artifact", "set_terminated"):
        real = getattr(MlflowClient, call)

        def stopped(self: MlflowClient, *given: object, **named: object) -> None:
            raise KeyboardInterrupt

        with monkeypatch.context() as patch:
            patch.setattr(MlflowClient, call, stopped)
            with pytest.raises(KeyboardInterrupt):
                deliver(Store())
        assert real is getattr(MlflowClient, call)
        assert len(waiting(Store().undelivered)) == 1
    assert deliver(Store()) == 1
    (found,) = Store().runs(["work"])
    assert found.info.status == "FINISHED"
    assert found.data.tags[ORIGIN_TAG] == "one0000"
    assert len(Store().client().get_metric_history(found.info.run_id, "loss")) == 2


def test_a_run_below_another_finds_it_whichever_arrives_first(home: Path, tmp_path: Path) -> None:
    # The lower one began earlier by its clock, and is delivered first.
    keep(unknown_run("below", tmp_path / "below", "above0000", start_ms=10), Store().undelivered)
    keep(unknown_run("above", tmp_path / "above", start_ms=20), Store().undelivered)
    assert deliver(Store()) == 2
    runs = {run.info.run_name: run for run in Store().runs(["work"])}
    assert runs["below"].data.tags["mlflow.parentRunId"] == runs["above"].info.run_id


def test_a_file_that_a_later_call_has_replaced_is_not_taken_for_the_runs(home: Path, tmp_path: Path) -> None:
    run = unknown_run("one", tmp_path / "one")
    run.written.end_ms = int((tmp_path / "one" / "note.txt").stat().st_mtime * 1000) + 1
    keep(run, Store().undelivered)
    later = run.written.end_ms / 1000 + 10
    os.utime(tmp_path / "one" / "note.txt", (later, later))
    assert deliver(Store()) == 1
    (found,) = Store().runs(["work"])
    names = {file.path for file in Store().client().list_artifacts(found.info.run_id)}
    assert names == {"cases.parquet", "config.yaml", "metrics.json"}


def test_two_processes_do_not_deliver_at_the_same_time(home: Path, tmp_path: Path) -> None:
    keep(unknown_run("one", tmp_path / "one"), Store().undelivered)
    with FileLock(Store().undelivered / ".lock"):
        assert deliver(Store()) == 0
    assert deliver(Store()) == 1


def test_runs_wait_for_the_tracker_that_they_are_of(home: Path, tmp_path: Path) -> None:
    other = Store("http://127.0.0.1:9")
    keep(unknown_run("one", tmp_path / "one"), other.undelivered)
    assert waiting(other.undelivered)
    assert deliver(Store()) == 0
    assert waiting(other.undelivered)


def test_an_import_that_was_killed_is_completed_by_the_next(
    home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = keep(unknown_run("one", tmp_path / "one"), tmp_path / "elsewhere")

    def stopped(self: MlflowClient, *given: object, **named: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(MlflowClient, "log_inputs", stopped)
        assert main(["study=import_runs", f"archive={kept}"]) == 130
    (half,) = Store().runs(["work"])
    assert half.info.status == "RUNNING"
    with subprocess.Popen([sys.executable, "-c", ""]) as ended:
        ended.wait()
    Store().client().set_tag(half.info.run_id, "ctus.pid", str(ended.pid))
    assert main(["study=import_runs", f"archive={kept}"]) == 0
    (whole,) = Store().runs(["work"])
    assert (whole.info.run_id, whole.info.status) == (half.info.run_id, "FINISHED")
    assert Store().cases(whole.info.run_id) is not None
    before = whole.info.end_time
    assert main(["study=import_runs", f"archive={kept}"]) == 0
    assert [run.info.end_time for run in Store().runs(["work"])] == [before]
