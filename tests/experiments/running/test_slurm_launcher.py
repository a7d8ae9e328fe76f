"""The jobs of a call by a pretended Slurm: one sweep, killed jobs reported and marked, resumed ones not sent."""

from __future__ import annotations

import json
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from pretended_slurm import pretend

from experiments.cli import main
from experiments.errors import InputError
from experiments.provenance import SLURM_TAG
from experiments.running import slurm_queue, terminal
from experiments.running.slurm_queue import SlurmState
from experiments.tracking import HASH_TAG, PARENT_TAG, Store

SLURM = ["launcher=slurm", "launcher.poll_s=0.01"]


def of_kind(kind: str) -> list[Any]:
    return [run for run in Store().runs(["counting"]) if run.data.tags["ctus.kind"] == kind]


def test_all_jobs_are_one_array_and_one_sweep_with_the_same_hashes_as_here(
    counting_study: ModuleType, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    slurm = pretend(monkeypatch)
    assert main(["study=counting", "parts=[1,2,3]", *SLURM, "launcher.cpus=3"]) == 0
    (sweep,) = of_kind("sweep")
    jobs = of_kind("job")
    assert {run.data.tags[PARENT_TAG] for run in jobs} == {sweep.info.run_id}
    assert {run.info.status for run in [sweep, *jobs]} == {"FINISHED"}
    assert sorted(run.data.tags[SLURM_TAG] for run in jobs) == ["1_0", "1_1", "1_2"]
    assert slurm.arrays == [
        [run.data.tags[HASH_TAG] for run in sorted(jobs, key=lambda run: run.data.params["part"])]
    ]
    assert slurm.settings[0].cpus == 3
    assert not any("launcher" in name for run in jobs for name in run.data.params)
    # Another launcher makes no other job.
    assert main(["study=counting", "parts=[1,2,3]", "resume=true"]) == 0
    assert counting_study.calls == [1, 2, 3]
    assert not (home / ".cache" / "plans").exists()


def test_a_killed_job_is_failed_with_slurms_word_and_resume_sends_it_alone(
    counting_study: ModuleType,
    home: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    slurm = pretend(monkeypatch, {1: SlurmState("OUT_OF_MEMORY", 0, 125)})
    assert main(["study=counting", "parts=[1,2,3]", *SLURM]) == 1
    said = (
        "Slurm job 1_1 ended before the job did: OUT_OF_MEMORY (it took more memory than launcher.memory_gb)"
    )
    assert said in capsys.readouterr().err
    (sweep,) = of_kind("sweep")
    assert sweep.info.status == "FAILED" and sweep.data.metrics["jobs_failed"] == 1
    slurm.ends.clear()
    assert main(["study=counting", "parts=[1,2,3]", *SLURM, "resume=true"]) == 0
    assert [len(keys) for keys in slurm.arrays] == [3, 1] and slurm.arrays[1] == [slurm.arrays[0][1]]
    assert sorted(counting_study.calls) == [1, 2, 3]
    (sweep,) = of_kind("sweep")
    assert sweep.info.status == "FINISHED" and sweep.data.metrics["jobs_resumed"] == 2


def test_a_run_that_a_killed_job_left_running_is_failed_with_the_reason(
    counting_study: ModuleType, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    slurm = pretend(monkeypatch, {0: SlurmState("FAILED", 137)})
    real = slurm.submit

    def submit(keys: Any, *rest: Any) -> list[str]:
        tags = {
            HASH_TAG: keys[0],
            "ctus.kind": "job",
            SLURM_TAG: "1_0",
            "ctus.host": "node7",
            "ctus.pid": "5",
        }
        Store().start("counting", "on a node", tags)
        # Of the same job in an array of another call, which still runs.
        Store().start("counting", "of another call", {**tags, SLURM_TAG: "99_0"})
        return real(keys, *rest)

    monkeypatch.setattr("experiments.running.array_task.submit", submit)
    assert main(["study=counting", "parts=[1]", *SLURM]) == 1
    by_name = {run.info.run_name: run for run in Store().runs(["counting"])}
    killed, other = by_name["on a node"], by_name["of another call"]
    assert killed.info.status == "FAILED"
    assert (
        "Slurm job 1_0 ended before the job did: FAILED (killed by signal 9)"
        in killed.data.tags["ctus.error"]
    )
    assert other.info.status == "RUNNING"


def test_a_call_longer_than_an_array_sends_several_in_turn(
    counting_study: ModuleType, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    slurm = pretend(monkeypatch)
    assert main(["study=counting", "parts=[1,2,3,4,5]", *SLURM, "launcher.array_size=2"]) == 0
    assert [len(keys) for keys in slurm.arrays] == [2, 2, 1]
    assert len(of_kind("sweep")) == 1 and len(of_kind("job")) == 5


def test_a_password_in_the_trackers_address_goes_with_the_environment_and_into_no_file(
    counting_study: ModuleType, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    slurm = pretend(monkeypatch)
    written: list[str] = []
    real = slurm.submit

    def submit(keys: Any, folder: Path, *rest: Any) -> list[str]:
        written.extend(path.read_text() for path in folder.glob("*.json"))
        return real(keys, folder, *rest)

    monkeypatch.setattr("experiments.running.array_task.submit", submit)
    secret = "http://me:hidden@127.0.0.1:9/"
    main(["study=counting", "parts=[1,2]", *SLURM, f"tracking.uri='{secret}'", "tracking.enabled=false"])
    assert slurm.environments == [{"MLFLOW_TRACKING_URI": secret}]
    assert len(written) == 3 and not any("hidden" in text for text in written)


def test_ctrl_c_cancels_what_was_sent(
    counting_study: ModuleType, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    slurm = pretend(monkeypatch, {0: SlurmState("RUNNING"), 1: SlurmState("PENDING")})
    looks = []

    def states(ids: Any) -> dict[str, SlurmState] | None:
        looks.append(1)
        if len(looks) == 2:
            raise KeyboardInterrupt
        return slurm.states(ids)

    monkeypatch.setattr(slurm_queue, "states", states)
    assert main(["study=counting", *SLURM]) == 130
    assert slurm.cancelled == ["1"]
    assert [run.info.status for run in of_kind("sweep")] == ["FAILED"]
    assert not (home / ".cache" / "plans").exists()


def test_while_slurm_does_not_answer_the_call_waits(
    counting_study: ModuleType,
    home: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    slurm = pretend(monkeypatch, {1: SlurmState("TIMEOUT")})
    answers = [None, None, None]
    monkeypatch.setattr(terminal, "LINE_EVERY_S", 0.0)
    monkeypatch.setattr(slurm_queue, "states", lambda ids: answers.pop() if answers else slurm.states(ids))
    assert main(["study=counting", *SLURM]) == 1
    said = capsys.readouterr().err
    assert "no answer, waiting for 1 of 2 jobs" in said and "TIMEOUT" in said
    assert not answers


def test_what_slurm_refuses_is_the_users_input_and_leaves_nothing(
    counting_study: ModuleType,
    home: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    pretend(monkeypatch)

    def submit(*arguments: Any) -> list[str]:
        raise InputError("launcher: expected jobs that Slurm takes, received: invalid partition specified")

    monkeypatch.setattr("experiments.running.array_task.submit", submit)
    assert main(["study=counting", *SLURM]) == 2
    assert "invalid partition" in capsys.readouterr().err
    assert not (home / ".cache" / "plans").exists()


def test_jobs_that_a_killed_call_left_in_the_queue_are_waited_for(
    counting_study: ModuleType,
    home: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    # The first call dies while it watches; its array keeps running.
    slurm = pretend(monkeypatch, {0: SlurmState("RUNNING"), 1: SlurmState("RUNNING")})
    folders: list[Path] = []
    real = slurm.submit

    def submit(keys: Any, folder: Path, *rest: Any) -> list[str]:
        folders.append(folder)
        return real(keys, folder, *rest)

    class Dies(BaseException):
        pass

    def dies(*arguments: Any) -> None:
        raise Dies

    with monkeypatch.context() as patch:
        patch.setattr("experiments.running.array_task.submit", submit)
        patch.setattr("experiments.running.slurm_launcher.SlurmLauncher._watched", dies)
        patch.setattr("experiments.running.slurm_launcher._end", lambda *arguments: None)
        patch.setattr("experiments.running.launcher.remove_plan", lambda folder: None)
        with pytest.raises(Dies):
            main(["study=counting", *SLURM])
    (folder,) = folders
    record = json.loads((folder / "array.json").read_text())
    record["process"]["ctus.pid"] = "4194305"  # above the largest there is
    (folder / "array.json").write_text(json.dumps(record))
    for more in ([], ["resume=true"], SLURM):
        assert main(["study=counting", *more]) == 2
        assert "are in the queue of Slurm (job 1)" in capsys.readouterr().err
    assert main(["study=counting", "parts=[7,8]"]) == 0  # other jobs go on

    def ends(ids: Any) -> dict[str, SlurmState]:
        for key in list(record["jobs"]):
            if not (folder / f"{key}.json").is_file():
                from experiments.running.array_task import ArrayTask

                ArrayTask(str(folder), key)()
                break
        return slurm.states(ids) or {}

    monkeypatch.setattr(slurm_queue, "states", ends)
    assert main(["study=counting", *SLURM, "resume=true"]) == 0
    assert len(slurm.arrays) == 1 and sorted(counting_study.calls) == [1, 2, 7, 8]
