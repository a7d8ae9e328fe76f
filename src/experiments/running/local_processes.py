"""The jobs of one call side by side: a process for each, as many at a time as asked for.

A process that is killed takes only its own job with it, which a pool of processes could not promise.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from experiments import files
from experiments.running import run_job
from experiments.running.jobs import Job, Plan
from experiments.running.run_job import Report

WORKER = (sys.executable, "-m", "experiments.running.local_processes")
# What the libraries read, when they are loaded, to learn how many threads they may start.
THREAD_SETTINGS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
LOOK_EVERY_S = 0.1
TIME_TO_END_S = 30.0


def run_in_processes(
    planned: Sequence[Job], plan: Plan, folder: Path, at_once: int, worker: Sequence[str] = WORKER
) -> None:
    """Run all jobs, ``at_once`` at a time; leave a report of each in ``folder``, also of one that was killed.

    ``worker`` is the command of a process; it gets ``folder`` and the job's hash as its last arguments. The cores are
    shared out evenly between the processes.
    """
    waiting, running = list(planned), list[tuple[Job, subprocess.Popen[bytes]]]()
    environment = {**os.environ, **_threads(at_once)}
    try:
        while waiting or running:
            while waiting and len(running) < at_once:
                job = waiting.pop(0)
                files.write_text(
                    _job_file(folder, job.hash), json.dumps({"config": job.config, "label": job.label})
                )
                command = [*worker, str(folder), job.hash]
                running.append((job, subprocess.Popen(command, env=environment)))
            time.sleep(LOOK_EVERY_S)
            for job, process in [one for one in running if one[1].poll() is not None]:
                running.remove((job, process))
                _report_of_killed(job, plan, folder, process.returncode)
    except BaseException:
        _stop([process for _, process in running])
        raise


def main(arguments: Sequence[str]) -> int:
    """Run one job of a plan: the folder of the plan, the job's hash."""
    from experiments.running import run_sweep
    from experiments.running.terminal import TerminalProgress, plain_console

    folder, key = Path(arguments[0]), arguments[1]
    content = json.loads(_job_file(folder, key).read_text(encoding="utf-8"))
    job = Job(content["config"], key, content["label"])
    # Bars of several processes would overwrite each other; lines say whose they are.
    progress = TerminalProgress(plain_console(), prefix=f"{job.label}: " if job.label else "")
    with run_sweep.stoppable():
        run_sweep.run_one(job, Plan.read(folder / "plan.json"), folder, progress)
    return 0


def _job_file(folder: Path, key: str) -> Path:
    return folder / f"{key}.job.json"


def _threads(at_once: int) -> dict[str, str]:
    """As many threads for each process as it has cores of its own, unless the user has said how many."""
    share = str(max(1, (os.cpu_count() or 1) // at_once))
    return {name: os.environ.get(name, share) for name in THREAD_SETTINGS}


def _report_of_killed(job: Job, plan: Plan, folder: Path, code: int) -> None:
    path = run_job.report_file(folder, job.hash)
    if path.is_file():
        return
    how = f"signal {-code}" if code < 0 else f"exit code {code}"
    message = f"its process ended by {how} before the job did"
    print(f"{job.label}: {message}", file=sys.stderr)
    Report(job.hash, job.label, "failed", str(plan.folder_of(job.hash)), message=message).write(path)


def _stop(processes: Sequence[subprocess.Popen[bytes]]) -> None:
    """Let the processes end their runs as FAILED; what does not end in time is killed."""
    for process in processes:
        process.terminate()
    deadline = time.monotonic() + TIME_TO_END_S
    for process in processes:
        try:
            process.wait(timeout=max(0.0, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
