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

from experiments.provenance import PID_TAG
from experiments.running import run_job, worker
from experiments.running.gpu_shares import VISIBLE, gpus_needed, next_gpus, visible_gpus
from experiments.running.jobs import Job, Plan
from experiments.running.launcher import Launched, plan_folder
from experiments.running.run_job import Report

# -P: a folder called models in the current one is none of ours.
WORKER = (sys.executable, "-P", "-m", "experiments.running.worker")
LOOK_EVERY_S = 0.1
TIME_TO_END_S = 30.0


@dataclass(frozen=True)
class LocalProcesses:
    """Runs every job in a process of its own on this machine.

    The cores are shared out evenly between the processes, and so are the GPUs: each process sees one.

    Parameters
    ----------
    at_once : int
        Number of processes at the same time.
    command : sequence of str, optional
        Command of a process; it gets the folder of the plan and the job's hash as its last arguments.
    gpus : tuple of str or None, optional
        GPUs to share out; None for those that this process may see.
    """

    at_once: int
    command: Sequence[str] = WORKER
    gpus: tuple[str, ...] | None = None

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
            processes = self._run_all(planned, plan, folder)
            paths = {job.hash: run_job.report_file(folder, job.hash) for job in planned}
            reports = {key: Report.read(path) for key, path in paths.items() if path.is_file()}
            return Launched(reports, processes=processes)

    def _run_all(self, planned: Sequence[Job], plan: Plan, folder: Path) -> dict[str, dict[str, str]]:
        """Run the jobs; returns what their runs say of their processes."""
        waiting, running = list(planned), list[tuple[Job, subprocess.Popen[bytes]]]()
        processes, gpu_of = {}, dict[str, str]()
        gpus = visible_gpus() if self.gpus is None else self.gpus
        try:
            while waiting or running:
                while waiting and len(running) < self.at_once:
                    job = waiting.pop(0)
                    busy = [gpu for each, _ in running for gpu in gpu_of.get(each.hash, "").split(",") if gpu]
                    gpu = next_gpus(gpus, busy, gpus_needed(job.config))
                    if gpu is not None:
                        gpu_of[job.hash] = gpu
                    running.append((job, self._started(job, folder, gpu)))
                    processes[job.hash] = {PID_TAG: str(running[-1][1].pid)}
                time.sleep(LOOK_EVERY_S)
                for job, process in [one for one in running if one[1].poll() is not None]:
                    running.remove((job, process))
                    _report_killed(job, plan, folder, process.returncode)
        except BaseException:
            _stop([process for _, process in running])
            raise
        return processes

    def _started(self, job: Job, folder: Path, gpu: str | None) -> subprocess.Popen[bytes]:
        worker.write_job(job, folder)
        environment = {
            **os.environ,
            **_threads(self.at_once),
            **({} if gpu is None else {VISIBLE: gpu}),
            **worker.tracker_secret(job.config),
            worker.PARENT: str(os.getpid()),
        }
        return subprocess.Popen([*self.command, str(folder), job.hash], env=environment)


def _threads(at_once: int) -> dict[str, str]:
    """As many threads for each process as it has cores of its own, unless the user has said how many."""
    share = str(max(1, (os.cpu_count() or 1) // at_once))
    return {name: os.environ.get(name, share) for name in worker.THREAD_SETTINGS}


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
