"""What the tracker refuses at the end loses nothing: files come first, and the rest is logged and said."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from types import ModuleType

import pandas as pd
import pytest
from mlflow.tracking import MlflowClient
from sqlalchemy.exc import OperationalError

from experiments.cli import main
from experiments.tracking import Store
from experiments.tracking.undelivered import waiting


def test_any_name_of_a_metric_is_taken(counting_study: ModuleType, home: Path) -> None:
    long, odd = "x" * 400, "a,b/../c?"
    metrics = {f"unet augmentation=strong {long}/dsc": 1.0, odd: 2.0, "/root": 3.0, "value_mean": 4.0}
    real_run = counting_study.run

    def run(*, part, fail_on, refuse_on, seed, workspace, progress, data):
        outcome = real_run(
            part=part, fail_on=fail_on, refuse_on=refuse_on, seed=seed, workspace=workspace, progress=progress
        )
        return dataclasses.replace(outcome, metrics=metrics)

    counting_study.run = run
    out = home / "result"
    words = ["parts=[1]", f"out={out}"]
    assert main(["study=counting", *words]) == 0
    (job,) = Store().runs(["counting"])
    assert job.info.status == "FINISHED"
    assert {1.0, 2.0, 3.0} <= set(job.data.metrics.values())
    assert all(len(name) <= 250 for name in job.data.metrics)
    assert Store().metrics(job.info.run_id).items() >= metrics.items()
    assert (out / "summary.md").is_file()
    counting_study.run = real_run
    counting_study.calls.clear()
    assert main(["study=counting", *words, "resume=true"]) == 0
    assert counting_study.calls == []


@pytest.mark.parametrize("call", ["log_batch", "log_artifact", "log_inputs", "set_terminated"])
def test_a_refusal_at_the_end_is_said_and_everything_is_there(
    counting_study: ModuleType,
    home: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    call: str,
) -> None:
    real_run = counting_study.run
    real = getattr(MlflowClient, call)
    computed: list[int] = []

    def run(*, part, fail_on, refuse_on, seed, workspace, progress, data):
        computed.append(part)
        return real_run(
            part=part, fail_on=fail_on, refuse_on=refuse_on, seed=seed, workspace=workspace, progress=progress
        )

    def refuse(self: MlflowClient, *given: object, **named: object) -> object:
        if len(computed) == 2:
            raise RuntimeError(f"{call}: the disk is full")
        return real(self, *given, **named)

    counting_study.run = run
    monkeypatch.setattr(MlflowClient, call, refuse)
    out = home / "result"
    assert main(["study=counting", f"out={out}"]) == 0
    said = capsys.readouterr()
    assert "The tracker refused" in said.err
    assert "the disk is full" in said.err
    assert "counted" in said.out
    assert (out / "part-2" / "cases.parquet").is_file()
    assert pd.read_parquet(out / "cases.parquet")["value"].tolist() == pytest.approx([4 / 3, 5 / 3])

    monkeypatch.setattr(MlflowClient, call, real)
    assert main(["study=counting", f"out={out}", "resume=true"]) == 0
    assert pd.read_parquet(out / "cases.parquet")["value"].tolist() == pytest.approx([4 / 3, 5 / 3])
    sweep = [run for run in Store().runs(["counting"]) if run.data.tags["ctus.kind"] == "sweep"]
    assert "FINISHED" in {run.info.status for run in sweep}


def test_files_are_written_before_they_are_logged(
    counting_study: ModuleType, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, seen = home / "result", []
    real = MlflowClient.log_artifact

    def interrupted(self: MlflowClient, run_id: str, path: str, place: str | None = None) -> None:
        if Path(path).name == "config.yaml":  # logged when the run begins
            real(self, run_id, path, place)
            return
        seen.append(Path(path))
        raise KeyboardInterrupt

    monkeypatch.setattr(MlflowClient, "log_artifact", interrupted)
    assert main(["study=counting", "parts=[1]", f"out={out}"]) == 130
    assert seen[0].is_file()
    assert (out / "half.txt").is_file()
    assert (out / "cases.parquet").is_file()


@pytest.mark.parametrize("call", ["log_batch", "log_text", "log_artifact", "set_terminated", "create_run"])
def test_what_a_locked_or_read_only_store_refuses_is_kept_for_import(
    counting_study: ModuleType,
    home: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    call: str,
) -> None:
    real, begun = getattr(MlflowClient, call), []

    def refuse(self: MlflowClient, *given: object, **named: object) -> object:
        begun.append(call)
        if call == "create_run" and len(begun) < 3:  # the runs above the jobs are there already
            return real(self, *given, **named)
        raise OperationalError("UPDATE runs", None, Exception("attempt to write a readonly database"))

    monkeypatch.setattr(MlflowClient, call, refuse)
    out = home / "result"
    assert main(["study=counting", f"out={out}"]) == 0
    assert "a later call delivers it" in capsys.readouterr().err
    monkeypatch.setattr(MlflowClient, call, real)
    assert waiting(Store().undelivered)
    assert main(["study=export_runs"]) == 0
    assert "runs that had waited for it" in capsys.readouterr().err
    assert not waiting(Store().undelivered)
    runs = list(Store().runs(["counting"]))
    assert {run.info.status for run in runs} == {"FINISHED"}
    assert sorted(run.data.tags["ctus.kind"] for run in runs) == ["job", "job", "sweep"]
    (sweep,) = [run for run in runs if run.data.tags["ctus.kind"] == "sweep"]
    for run in runs:
        if run is not sweep:
            assert run.data.tags["mlflow.parentRunId"] == sweep.info.run_id
            assert Store().metrics(run.info.run_id)["value_mean"] == pytest.approx(
                (3 + int(run.data.params["part"])) / 3
            )
            assert "half.txt" in {file.path for file in Store().client().list_artifacts(run.info.run_id)}
    counting_study.calls.clear()
    assert main(["study=counting", f"out={out}", "resume=true"]) == 0
    assert counting_study.calls == []


def test_what_the_tracker_refuses_for_good_waits_on_and_holds_nothing_else_up(
    counting_study: ModuleType,
    home: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def refuse(self: MlflowClient, *given: object, **named: object) -> object:
        raise RuntimeError("no data sets here")

    with monkeypatch.context() as patch:
        patch.setattr(MlflowClient, "log_inputs", refuse)
        assert main(["study=counting", "parts=[1]", f"out={home / 'a'}"]) == 0
        assert main(["study=counting", "parts=[2]", f"out={home / 'b'}"]) == 0
        assert "2 runs wait for the tracker" in capsys.readouterr().err
        assert main(["study=export_runs"]) == 0
    assert len(waiting(Store().undelivered)) == 2
    assert main(["study=export_runs"]) == 0
    assert not waiting(Store().undelivered)
    assert [run.info.status for run in Store().runs(["counting"])] == ["FINISHED", "FINISHED"]


def test_what_cannot_be_kept_in_the_project_is_kept_with_the_results(
    counting_study: ModuleType,
    home: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def refuse(self: MlflowClient, *given: object, **named: object) -> object:
        raise RuntimeError("no data sets here")

    (home / "mlruns" / "untracked").touch()
    with monkeypatch.context() as patch:
        patch.setattr(MlflowClient, "log_inputs", refuse)
        assert main(["study=counting", "parts=[1]", f"out={home / 'a'}"]) == 0
    (kept,) = (home / "a" / "untracked").iterdir()
    assert f"study=import_runs archive={kept} delivers it" in capsys.readouterr().err
    assert main(["study=import_runs", f"archive={kept}"]) == 0
    (run,) = Store().runs(["counting"])
    assert run.info.status == "FINISHED"
    assert len(run.inputs.dataset_inputs) == 1
