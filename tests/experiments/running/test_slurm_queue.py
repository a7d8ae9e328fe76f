"""What Slurm says of jobs, read from answers as Slurm 22.05 gives them."""

from __future__ import annotations

import subprocess
from typing import Any

import pytest

from experiments.errors import InputError
from experiments.running import slurm_queue
from experiments.running.slurm_queue import SlurmState, read_accounting, read_controller

CONTROLLER = (
    "JobId=2 ArrayJobId=2 ArrayTaskId=4 ArrayTaskThrottle=2 JobName=ctus UserId=a(1) JobState=RUNNING "
    "Reason=None Restarts=0 ExitCode=0:0 RunTime=00:00:10 Command=/x y/JobState=FAILED \n"
    "JobId=6 ArrayJobId=2 ArrayTaskId=3 JobName=ctus JobState=FAILED Reason=NonZeroExitCode ExitCode=137:0 \n"
    "JobId=5 ArrayJobId=2 ArrayTaskId=2 JobName=ctus JobState=OUT_OF_MEMORY Reason=OutOfMemory ExitCode=0:125 \n"
    "JobId=7 ArrayJobId=2 ArrayTaskId=5-7,9%2 JobName=ctus JobState=PENDING Reason=JobArrayTaskLimit ExitCode=0:0 \n"
)


def test_every_job_of_an_array_has_its_state_those_that_wait_together_too() -> None:
    found = read_controller(CONTROLLER)
    assert {key: state.state for key, state in found.items()} == {
        "2_4": "RUNNING",
        "2_3": "FAILED",
        "2_2": "OUT_OF_MEMORY",
        **dict.fromkeys(("2_5", "2_6", "2_7", "2_9"), "PENDING"),
    }
    assert [key for key, state in found.items() if state.ended] == ["2_3", "2_2"]
    assert read_controller("JobId=17 JobName=x JobState=COMPLETED ExitCode=0:0") == {
        "17": SlurmState("COMPLETED")
    }


def test_the_accounting_knows_jobs_that_the_controller_has_forgotten() -> None:
    text = (
        "9_0|COMPLETED|0:0\n9_0.batch|COMPLETED|0:0\n9_0.0|FAILED|1:0\n9_1|CANCELLED by 1000|0:15\n"
        "9_[2-3%4]|PENDING|0:0\n10|TIMEOUT|0:0\n"
    )
    found = read_accounting(text)
    assert {key: state.state for key, state in found.items()} == {
        "9_0": "COMPLETED",
        "9_1": "CANCELLED",
        "9_2": "PENDING",
        "9_3": "PENDING",
        "10": "TIMEOUT",
    }
    assert found["9_1"].signal == 15


@pytest.mark.parametrize(
    ("state", "said"),
    [
        (SlurmState("FAILED", 137), "FAILED (killed by signal 9)"),
        (SlurmState("FAILED", 0, 11), "FAILED (killed by signal 11)"),
        (SlurmState("FAILED", 3), "FAILED (exit code 3)"),
        (SlurmState("OUT_OF_MEMORY", 0, 125), "OUT_OF_MEMORY (it took more memory than launcher.memory_gb)"),
        (SlurmState("TIMEOUT"), "TIMEOUT (it took longer than launcher.timeout_min)"),
        (SlurmState("NODE_FAIL"), "NODE_FAIL (its node failed)"),
        (SlurmState("CANCELLED"), "CANCELLED (somebody cancelled it)"),
    ],
)
def test_a_state_says_what_happened(state: SlurmState, said: str) -> None:
    assert str(state) == said


class Answers:
    """Commands of Slurm that answer as they are told to."""

    def __init__(self, **answers: tuple[int, str, str]) -> None:
        self.answers, self.asked = answers, list[list[str]]()

    def __call__(self, words: list[str], **options: Any) -> subprocess.CompletedProcess[str]:
        self.asked.append(words)
        if words[0] not in self.answers:
            raise FileNotFoundError(words[0])
        return subprocess.CompletedProcess(words, *self.answers[words[0]])


def test_a_controller_that_is_away_ends_no_job(monkeypatch: pytest.MonkeyPatch) -> None:
    down = Answers(scontrol=(1, "", "slurm_load_jobs error: Unable to contact slurm controller"))
    monkeypatch.setattr(slurm_queue.subprocess, "run", down)
    assert slurm_queue.states(["2_3"]) is None
    monkeypatch.setattr(slurm_queue.subprocess, "run", Answers())
    assert slurm_queue.states(["2_3"]) is None


def test_what_the_controller_has_forgotten_is_asked_of_the_accounting(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    forgotten = (1, "", "slurm_load_jobs error: Invalid job id specified")
    answers = Answers(scontrol=forgotten, sacct=(0, "2_3|COMPLETED|0:0\n", ""))
    monkeypatch.setattr(slurm_queue.subprocess, "run", answers)
    found = slurm_queue.states(["2_3", "2_4"])
    assert found == {"2_3": SlurmState("COMPLETED"), "2_4": SlurmState("UNKNOWN")}
    assert found["2_4"].ended
    without = Answers(scontrol=forgotten, sacct=(1, "", "Slurm accounting storage is disabled"))
    monkeypatch.setattr(slurm_queue.subprocess, "run", without)
    assert slurm_queue.states(["2_3"]) == {"2_3": SlurmState("UNKNOWN")}


def test_jobs_are_cancelled_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    answers = Answers(scancel=(0, "", ""))
    monkeypatch.setattr(slurm_queue.subprocess, "run", answers)
    slurm_queue.cancel(["2", "7"])
    assert answers.asked == [["scancel", "2", "7"]]


def test_a_machine_without_slurm_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        slurm_queue.shutil, "which", lambda name: None if name == "srun" else f"/usr/bin/{name}"
    )
    with pytest.raises(InputError, match=r"expected a machine that Slurm takes jobs from .* found no srun"):
        slurm_queue.require_slurm()
