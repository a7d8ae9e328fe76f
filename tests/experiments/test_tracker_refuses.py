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
    assert "study=import_runs archive=" in capsys.readouterr().err
    monkeypatch.setattr(MlflowClient, call, real)
    kept = sorted(out.glob("part-*/untracked"))
    assert kept
    for folder in kept:
        assert main(["study=import_runs", f"archive={folder}"]) == 0
    counting_study.calls.clear()
    done = {
        run.data.tags["ctus.label"]: Store().metrics(run.info.run_id)["value_mean"]
        for run in Store().runs(["counting"])
        if run.info.status == "FINISHED" and run.data.tags["ctus.kind"] == "job"
    }
    assert len(done) == 2
    assert main(["study=counting", f"out={out}", "resume=true"]) == 0
    assert counting_study.calls == []
