"""What submitit carries to a node, by its own executor for this machine and its debugging one."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import submitit

from experiments.errors import InputError
from experiments.running import array_task, worker
from experiments.running.array_task import ArrayTask, TimeLimitError
from experiments.running.jobs import Job, Plan
from experiments.running.slurm_settings import SlurmSettings


def counted(home: Path, key: str = "k" * 64) -> Path:
    folder = home / "plan"
    folder.mkdir()
    config = {"study": "counting", "part": 1, "fail_on": [], "refuse_on": [], "seed": 0, "needed": "here"}
    job = Job({**config, "data": None, "tracking": {"uri": None, "enabled": False}}, key, "part=1")
    Plan("counting", {key: "part=1", "other": "part=2"}, str(home / "out")).write(folder)
    worker.write_job(job, folder)
    return folder


def test_it_runs_a_job_and_leaves_its_report(counting_study: ModuleType, home: Path) -> None:
    folder = counted(home)
    executor = submitit.DebugExecutor(folder / "slurm")
    assert executor.submit(ArrayTask(str(folder), "k" * 64)).result() == 0
    assert json.loads((folder / f"{'k' * 64}.json").read_text())["status"] == "finished"
    assert counting_study.calls == [1]


def test_it_can_be_sent_and_queued_again(home: Path) -> None:
    task = ArrayTask("/folder", "key")
    again = task.checkpoint()
    again.dump(home / "task.pkl")
    assert submitit.core.utils.DelayedSubmission.load(home / "task.pkl").function == task


def test_a_job_that_is_queued_again_goes_on_where_it_was(
    counting_study: ModuleType, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[bool] = []
    monkeypatch.setattr(worker, "main", lambda words, again: seen.append(again) or 0)
    for restarts in (None, "0", "1", "2"):
        if restarts is None:
            monkeypatch.delenv("SLURM_RESTART_COUNT", raising=False)
        else:
            monkeypatch.setenv("SLURM_RESTART_COUNT", restarts)
        ArrayTask(str(home), "key")()
    assert seen == [False, False, True, True]
    training = {"trainer": {"resume": False, "max_epochs": 3}, "seed": 1}
    assert worker.going_on(training) == {
        "trainer": {"resume": True, "max_epochs": 3},
        "seed": 1,
        "resume": True,
    }
    assert worker.going_on({"seed": 1}) == {"seed": 1, "resume": True}


def test_the_time_limit_has_its_name_where_submitit_gives_a_job_up(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def gives_up(number: int, frame: Any) -> None:
        raise submitit.core.utils.UncompletedJobError("Job not requeued because: timed-out too many times.")

    def warned(words: Any, again: bool) -> int:
        signal.raise_signal(signal.SIGUSR2)
        return 0

    before = signal.signal(signal.SIGUSR2, gives_up)
    try:
        monkeypatch.setattr(worker, "main", warned)
        with pytest.raises(TimeLimitError, match="TIMEOUT: the job took longer"):
            ArrayTask(str(home), "key")()
        assert signal.getsignal(signal.SIGUSR2) is gives_up
    finally:
        signal.signal(signal.SIGUSR2, before)


def sbatch_that(folder: Path, does: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, text in {"sbatch": does, "srun": "true"}.items():
        (folder / name).write_text(f"#!/bin/bash\n{text}\n")
        (folder / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")


def test_several_jobs_are_an_array_with_the_threads_of_its_cores_and_no_allocation_of_the_caller(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sbatch_that(home, f'cp "$1" {home}/script; env > {home}/seen; echo Submitted batch job 17', monkeypatch)
    for name, value in {
        "SLURM_JOB_ID": "3",
        "SLURM_MEM_PER_CPU": "1",
        "SLURM_CONF": "/etc/slurm.conf",
        worker.PARENT: "1",
    }.items():
        monkeypatch.setenv(name, value)
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    before = dict(os.environ)
    ids = array_task.submit(["a", "b", "c"], home, SlurmSettings(cpus=6), "ctus-counting", {"WITH": "it"})
    assert ids == ["17_0", "17_1", "17_2"]
    assert dict(os.environ) == before
    seen = dict(line.partition("=")[::2] for line in (home / "seen").read_text().splitlines())
    assert seen["OMP_NUM_THREADS"] == "6" and seen["WITH"] == "it" and seen["SLURM_CONF"] == "/etc/slurm.conf"
    assert not {"SLURM_JOB_ID", "SLURM_MEM_PER_CPU", worker.PARENT} & seen.keys()
    script = (home / "script").read_text()
    assert "#SBATCH --array=0-2%3" in script and "#SBATCH --cpus-per-task=6" in script
    sent = [
        submitit.core.utils.DelayedSubmission.load(home / "slurm" / f"17_{n}_submitted.pkl") for n in range(3)
    ]
    assert [one.function for one in sent] == [ArrayTask(str(home), key) for key in "abc"]


def test_what_sbatch_refuses_is_said_in_its_words_and_once(
    home: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    sbatch_that(home, "echo 'sbatch: error: invalid partition specified: nowhere' >&2; exit 1", monkeypatch)
    with pytest.raises(InputError, match="received: sbatch: error: invalid partition specified: nowhere"):
        array_task.submit(["a", "b"], home, SlurmSettings(), "ctus", {})
    assert capsys.readouterr().err == ""


def test_the_last_words_of_a_job_are_those_of_its_log(home: Path) -> None:
    (home / "slurm").mkdir()
    (home / "slurm" / "2_3_0_log.err").write_text(
        "submitit INFO x\none\n\ntwo\nslurmstepd: error: three\nfour\n"
    )
    assert array_task.last_words(home, "2_3") == "two\nslurmstepd: error: three\nfour"
    assert array_task.last_words(home, "2_4") == ""
