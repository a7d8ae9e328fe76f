"""One job of a plan, wherever it runs: in the process of the call, or in one that a launcher started for it.

``python -m experiments.running.worker <folder> <hash>`` runs the job of that hash; the folder holds the plan and the
job's configuration, and gets the report of how the job ended.
"""

from __future__ import annotations

import gc
import json
import os
import signal
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from experiments import files
from experiments.masking import masked, masked_values
from experiments.outcome import Outcome
from experiments.process_pool import end_with_parent
from experiments.running import run_job
from experiments.running.jobs import Job, Plan
from experiments.running.run_job import Report
from experiments.running.terminal import TerminalProgress, plain_console
from experiments.tracking import Store

# The process whose end is the end of this one too; without it the process is on its own.
PARENT = "CTUS_PARENT_PROCESS"
# What the libraries read, when they are loaded, to learn how many threads they may start.
THREAD_SETTINGS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def run_one(job: Job, plan: Plan, progress: TerminalProgress) -> tuple[Report, Outcome | None]:
    """Run one job of a plan and print what went wrong.

    Parameters
    ----------
    job : Job
        The job to run.
    plan : Plan
        The plan of the call that the job belongs to.
    progress : TerminalProgress
        Where progress is shown.

    Returns
    -------
    report : Report
        How the job ended.
    outcome : Outcome or None
        Its result; None if it was resumed or did not finish.
    """
    alone = len(plan.labels) == 1
    if not alone:
        number = list(plan.labels).index(job.hash) + 1
        progress.note(f"{plan.study}: {job.label} ({number} of {len(plan.labels)})")
    report, outcome = run_job.run_job(job, plan, store_of(job.config), progress)
    if report.status == "resumed":
        progress.note(f"{job.label or plan.study}: already finished, run {str(report.run_id)[:8]}")
    if report.message:
        print(report.message if alone else f"{job.label or plan.study}: {report.message}", file=sys.stderr)
    return report, outcome


def store_of(config: Mapping[str, Any]) -> Store:
    """Open the tracker that a configuration names.

    Parameters
    ----------
    config : mapping
        A resolved configuration with the settings of the tracker under ``tracking``.

    Returns
    -------
    Store
        The tracker.
    """
    return Store(**config["tracking"])


@contextmanager
def stoppable() -> Iterator[None]:
    """Turn SIGTERM into an exit that passes through every ``finally``, so that running runs end as FAILED."""

    def stop(number: int, frame: object) -> None:
        del number, frame
        raise SystemExit(128 + signal.SIGTERM)

    try:
        before = signal.signal(signal.SIGTERM, stop)
    except ValueError:  # only the main thread may set a handler; elsewhere the default stays
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def write_job(job: Job, folder: Path) -> None:
    """Write a job's configuration and label for the process that will run it.

    Parameters
    ----------
    job : Job
        The job.
    folder : Path
        The folder of the plan.
    """
    config = job.config
    if tracker_secret(config):
        # The words of the command line have it too.
        call = masked_values(config.get("call", {}))
        config = {**config, "tracking": {**config["tracking"], "uri": None}, "call": call}
    content = json.dumps({"config": config, "label": job.label})
    files.write_text(_job_file(folder, job.hash), content)


def tracker_secret(config: Mapping[str, Any]) -> dict[str, str]:
    """Give the environment that carries a tracking address with a password, which is written into no file.

    Parameters
    ----------
    config : mapping
        A resolved configuration.

    Returns
    -------
    dict of str to str
        The address under the name of MLflow's variable; empty where it holds no password.
    """
    uri = (config.get("tracking") or {}).get("uri")
    return {"MLFLOW_TRACKING_URI": uri} if isinstance(uri, str) and masked(uri) != uri else {}


def main(arguments: Sequence[str], *, again: bool = False) -> int:
    """Run one job of a plan and leave its report next to the plan.

    Parameters
    ----------
    arguments : sequence of str
        The folder of the plan and the job's hash.
    again : bool, optional
        Whether the job was begun before and interrupted: a training then goes on from its last whole epoch, and a
        finished run of the job is taken for it.

    Returns
    -------
    int
        The exit code: 0, however the job ended; its report says that.
    """
    folder, key = Path(arguments[0]), arguments[1]
    content = json.loads(_job_file(folder, key).read_text(encoding="utf-8"))
    config = going_on(content["config"]) if again else content["config"]
    job = Job(config, key, content["label"])
    # Bars of several processes would overwrite each other; lines say whose they are.
    progress = TerminalProgress(plain_console(), prefix=f"{job.label}: " if job.label else "")
    with stoppable():
        if PARENT in os.environ:
            end_with_parent(int(os.environ[PARENT]), gently=True)
        report, _ = run_one(job, Plan.read(folder), progress)
        report.write(run_job.report_file(folder, key))
    return 0


def going_on(config: Mapping[str, Any]) -> dict[str, Any]:
    """Have an interrupted job go on; its result is that of one that was never interrupted.

    Parameters
    ----------
    config : mapping
        A resolved configuration.

    Returns
    -------
    dict of str to Any
        The same with ``resume``, also that of a training.
    """
    trainer = config.get("trainer")
    if isinstance(trainer, Mapping) and "resume" in trainer:
        return {**config, "resume": True, "trainer": {**trainer, "resume": True}}
    return {**config, "resume": True}


def _job_file(folder: Path, key: str) -> Path:
    return folder / f"{key}.job.json"


if __name__ == "__main__":
    gc.set_threshold(20_000, 20, 20)  # as experiments.cli.main does
    sys.exit(main(sys.argv[1:]))
