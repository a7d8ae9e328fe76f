"""A sweep on a real Slurm of one node (``scripts/slurm_node.sh``), as ``make test-services`` starts it."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import waiting_study

from experiments.provenance import SLURM_TAG
from experiments.tracking import PARENT_TAG, Store

pytestmark = pytest.mark.services
REPOSITORY = Path(__file__).resolve().parents[1]
PATIENCE_S = 240.0
SMALL = [
    "launcher=slurm",
    "launcher.cpus=1",
    "launcher.memory_gb=2",
    "launcher.poll_s=0.5",
    "launcher.timeout_min=20",
]


@pytest.fixture
def place(home: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A project with the study ``waiting``, and a Slurm whose queue is empty again at the end."""
    answer = subprocess.run(["sinfo", "-h"], capture_output=True, text=True, check=False)
    assert answer.returncode == 0, (
        "make test-services starts the Slurm that this needs (scripts/slurm_node.sh up)"
    )
    waiting_study.install(home / "site")
    path = [str(REPOSITORY / "src"), str(home / "site"), os.environ.get("PYTHONPATH", "")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(path))
    (home / "notes").mkdir()
    yield home
    subprocess.run(["scancel", "--me"], check=False)
    wait_for(lambda: not queue())


def queue() -> list[str]:
    done = subprocess.run(["squeue", "-h", "-r", "-o", "%i"], capture_output=True, text=True, check=True)
    return done.stdout.split()


def wait_for(there: Callable[[], object]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not there():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.1)


def call(place: Path, parts: range, *more: str) -> subprocess.Popen[str]:
    words = [
        "study=waiting",
        f"parts=[{','.join(map(str, parts))}]",
        f"notes={place / 'notes'}",
        *SMALL,
        *more,
    ]
    return begun(place, words)


def begun(place: Path, words: list[str]) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "experiments.cli", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=place,
        # A shell has what it starts in the background ignore Ctrl-C.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )


def started(place: Path, part: int) -> list[list[str]]:
    """Process, threads and GPU of each attempt at a job."""
    file = place / "notes" / f"{part}.started"
    return [line.split() for line in file.read_text().splitlines()] if file.exists() else []


def of_kind(kind: str) -> list:
    return [run for run in Store().runs(["waiting"]) if run.data.tags["ctus.kind"] == kind]


def test_eight_jobs_are_one_sweep_a_killed_one_is_failed_and_resume_redoes_it_alone(place: Path) -> None:
    (place / "notes" / "3.wait").touch()
    running = call(place, range(8))
    wait_for(lambda: started(place, 3))
    os.kill(int(started(place, 3)[0][0]), signal.SIGKILL)
    _, errors = running.communicate(timeout=PATIENCE_S)
    assert running.returncode == 1, errors
    (sweep,) = of_kind("sweep")
    jobs = of_kind("job")
    assert len(jobs) == 8 and {run.data.tags[PARENT_TAG] for run in jobs} == {sweep.info.run_id}
    assert len({run.data.tags[SLURM_TAG].split("_")[0] for run in jobs}) == 1
    by_part = {run.data.params["part"]: run for run in jobs}
    assert {part for part, run in by_part.items() if run.info.status != "FINISHED"} == {"3"}
    killed = by_part["3"]
    assert killed.info.status == "FAILED" and "killed by signal 9" in killed.data.tags["ctus.error"]
    assert "killed by signal 9" in errors and "1 of 8 jobs did not finish" in errors
    assert sweep.info.status == "FAILED" and sweep.data.metrics["jobs_failed"] == 1
    assert [started(place, 0)[0][1], started(place, 0)[0][2]] == ["1", "none"]

    (place / "notes" / "3.wait").unlink()
    again = call(place, range(8), "resume=true")
    said, errors = again.communicate(timeout=PATIENCE_S)
    assert again.returncode == 0, errors
    assert "8 parts" in said
    assert [len(started(place, part)) for part in range(8)] == [1, 1, 1, 2, 1, 1, 1, 1]
    (sweep,) = of_kind("sweep")
    assert sweep.info.status == "FINISHED" and sweep.data.metrics["jobs_resumed"] == 7
    assert sorted(run.info.status for run in of_kind("job")) == ["FAILED"] + 8 * ["FINISHED"]
    assert not (place / ".cache" / "plans").exists()


def test_ctrl_c_cancels_the_array_and_ends_its_runs_as_failed(place: Path) -> None:
    for part in range(3):
        (place / "notes" / f"{part}.wait").touch()
    running = call(place, range(3))
    wait_for(lambda: started(place, 0) and started(place, 1))
    running.send_signal(signal.SIGINT)
    _, errors = running.communicate(timeout=PATIENCE_S)
    assert running.returncode == 130, errors
    assert "Cancelling 3 jobs" in errors and not queue()
    assert {run.info.status for run in [*of_kind("job"), *of_kind("sweep")]} == {"FAILED"}
    assert not (place / ".cache" / "plans").exists()


def test_an_array_outlives_a_call_that_is_killed_and_resume_waits_for_it(place: Path) -> None:
    for part in range(2):
        (place / "notes" / f"{part}.wait").touch()
    running = call(place, range(2))
    wait_for(lambda: started(place, 0) and started(place, 1))
    running.kill()
    running.wait()
    assert len(queue()) == 2
    words = ["study=waiting", "parts=[0,1]", f"notes={place / 'notes'}"]
    for more in ([*SMALL], ["resume=true"]):
        _, errors = begun(place, [*words, *more]).communicate(timeout=PATIENCE_S)
        assert "2 of 2 jobs of this call are in the queue of Slurm" in errors, errors
    again = call(place, range(2), "resume=true")
    wait_for(lambda: len(of_kind("sweep")) == 1)
    time.sleep(2.0)
    for part in range(2):
        (place / "notes" / f"{part}.wait").unlink()
    said, errors = again.communicate(timeout=PATIENCE_S)
    assert again.returncode == 0 and "2 parts" in said, errors
    assert [len(started(place, part)) for part in range(2)] == [1, 1]
    (sweep,) = of_kind("sweep")
    assert {run.data.tags[PARENT_TAG] for run in of_kind("job")} == {sweep.info.run_id}
    assert {run.info.status for run in [sweep, *of_kind("job")]} == {"FINISHED"}


def test_each_job_gets_a_gpu_of_its_own_and_what_slurm_will_not_take_is_refused(place: Path) -> None:
    for part in range(2):
        (place / "notes" / f"{part}.wait").touch()
    few = [word for word in SMALL if word != "launcher=slurm"]
    running = call(place, range(2), "launcher=slurm_gpu", *few)
    wait_for(lambda: started(place, 0) and started(place, 1))
    for part in range(2):
        (place / "notes" / f"{part}.wait").unlink()
    _, errors = running.communicate(timeout=PATIENCE_S)
    assert running.returncode == 0, errors
    assert {started(place, part)[0][2] for part in range(2)} == {"0", "1"}
    refused = call(place, range(2, 4), "launcher.partition=nowhere")
    _, errors = refused.communicate(timeout=PATIENCE_S)
    assert refused.returncode == 2 and "invalid partition" in errors
    assert len(of_kind("sweep")) == 1


def test_a_job_that_takes_too_much_memory_says_so(place: Path) -> None:
    running = call(place, range(1), "launcher.memory_gb=0.1")
    _, errors = running.communicate(timeout=PATIENCE_S)
    assert running.returncode == 1
    assert "exceeded memory limit" in errors or "launcher.memory_gb" in errors


def test_the_node_goes_down_and_comes_up_again_elsewhere(tmp_path: Path) -> None:
    script, folder = str(REPOSITORY / "scripts" / "slurm_node.sh"), tmp_path / "node"
    up = subprocess.run([script, "up", str(folder)], capture_output=True, text=True, check=True)
    own = {**os.environ, "SLURM_CONF": up.stdout.strip().partition("=")[2]}
    ran = subprocess.run(["srun", "hostname"], env=own, capture_output=True, text=True, check=True)
    assert ran.stdout.strip() and shutil.which("sinfo")
    subprocess.run([script, "down", str(folder)], check=True)
    assert not folder.exists()
    assert subprocess.run(["sinfo", "-h"], env=own, capture_output=True, check=False).returncode != 0
