"""The jobs of one call side by side: a process for each, as many at a time as asked for.

A process that is killed takes only its own job with it, which a pool of processes could not promise.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from experiments.running import run_job, worker
from experiments.running.jobs import Job, Plan
from experiments.running.launcher import Launched, plan_folder
from experiments.running.run_job import Report

# -P: a folder called models in the current one is none of ours.
WORKER = (sys.executable, "-P", "-m", "experiments.running.worker")
# What the libraries read, when they are loaded, to learn how many threads they may start.
THREAD_SETTINGS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
LOOK_EVERY_S = 0.1
TIME_TO_END_S = 30.0


@dataclass(frozen=True)
class LocalProcesses:
    """Runs every job in a process of its own on this machine.

    The cores are shared out evenly between the processes.

    Parameters
    ----------
    at_once : int
        Number of processes at the same time.
    command : sequence of str, optional
        Command of a process; it gets the folder of the plan and the job's hash as its last arguments.
    """

    at_once: int
    command: Sequence[str] = WORKER

    def run(self, planned: Sequence[Job], plan: Plan) -> Launched:
        """Run all jobs to their end.

        Parameters
        ----------
        planned : sequence of Job
            The jobs, in the order in which they are started.
        plan : Plan
            The plan of the call.

        Returns
        -------
        Launched
            The report of every job, also of one whose process was killed.
        """
        with plan_folder(plan) as folder:
            self._run_all(planned, plan, folder)
            paths = {job.hash: run_job.report_file(folder, job.hash) for job in planned}
            return Launched({key: Report.read(path) for key, path in paths.items() if path.is_file()})

    def _run_all(self, planned: Sequence[Job], plan: Plan, folder: Path) -> None:
        waiting, running = list(planned), list[tuple[Job, subprocess.Popen[bytes]]]()
        environment = {**os.environ, **_threads(self.at_once), worker.PARENT: str(os.getpid())}
        try:
            while waiting or running:
                while waiting and len(running) < self.at_once:
                    job = waiting.pop(0)
                    worker.write_job(job, folder)
                    command = [*self.command, str(folder), job.hash]
                    own = {**environment, **worker.tracker_secret(job.config)}
                    running.append((job, subprocess.Popen(command, env=own)))
                time.sleep(LOOK_EVERY_S)
                for job, process in [one for one in running if one[1].poll() is not None]:
                    running.remove((job, process))
                    _report_killed(job, plan, folder, process.returncode)
        except BaseException:
            _stop([process for _, process in running])
            raise


def _threads(at_once: int) -> dict[str, str]:
    """As many threads for each process as it has cores of its own, unless the user has said how many."""
    share = str(max(1, (os.cpu_count() or 1) // at_once))
    return {name: os.environ.get(name, share) for name in THREAD_SETTINGS}


def _report_killed(job: Job, plan: Plan, folder: Path, code: int) -> None:
    """Write the report of a job whose process ended without one."""
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
