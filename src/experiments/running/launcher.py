"""How the jobs of a call are started: the interface that every launcher has, and the one that starts no process.

The unit is the job, whether a study splits into several or a sweep has several points. A launcher that starts
processes writes the plan into a folder below the project (``plan_folder``), which other machines see if they see the
project, and starts ``python -m experiments.running.worker <folder> <hash>`` for every job.
"""

from __future__ import annotations

import contextlib
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from experiments.errors import InputError
from experiments.outcome import Outcome
from experiments.paths import project_root
from experiments.running import worker
from experiments.running.jobs import Job, Plan
from experiments.running.run_job import Report
from experiments.running.terminal import TerminalProgress
from registration.io.atomic import partial_name, remove_leftovers


@dataclass(frozen=True)
class Launched:
    """How the jobs of a call ended.

    Parameters
    ----------
    reports : mapping of str to Report
        The report of every job that left one, by the job's hash.
    outcome : Outcome or None, optional
        The result of a call's only job if it ran in this process, with its tables and figures.
    processes : mapping of str to mapping, optional
        By the hash of each job that ran in a process of its own, the tags that its runs have of that process: none of
        them is running any more.
    """

    reports: Mapping[str, Report]
    outcome: Outcome | None = None
    processes: Mapping[str, Mapping[str, str]] = field(default_factory=dict)


class Launcher(Protocol):
    """Runs the jobs of one call, each on its own, and hands back how they ended."""

    def run(self, planned: Sequence[Job], plan: Plan) -> Launched:
        """Run all jobs to their end.

        Parameters
        ----------
        planned : sequence of Job
            The jobs, in the order in which they are to be started.
        plan : Plan
            The plan of the call.

        Returns
        -------
        Launched
            The reports. A job without one did not finish.
        """
        ...


@dataclass(frozen=True)
class InProcess:
    """Runs the jobs in this process, one after the other."""

    def run(self, planned: Sequence[Job], plan: Plan) -> Launched:
        """Run all jobs to their end.

        Parameters
        ----------
        planned : sequence of Job
            The jobs, in the order in which they are run.
        plan : Plan
            The plan of the call.

        Returns
        -------
        Launched
            The report of every job, and the result of a lone one.
        """
        progress = TerminalProgress()
        reports: dict[str, Report] = {}
        outcome = None
        for job in planned:
            reports[job.hash], outcome = worker.run_one(job, plan, progress)
        return Launched(reports, outcome if len(planned) == 1 else None)


def plans_folder() -> Path:
    """Give the folder that plans lie in, below the project, which other machines see if they see the project.

    Returns
    -------
    Path
        The folder, which need not exist.
    """
    return project_root() / ".cache" / "plans"


@contextmanager
def plan_folder(plan: Plan, prefix: str | None = None) -> Iterator[Path]:
    """Make a folder below the project that holds the plan, and remove it when the call ends.

    Parameters
    ----------
    plan : Plan
        The plan, which is written into the folder.
    prefix : str or None, optional
        What its name begins with; None for a name by which the next call finds and removes it where this one was
        killed.

    Yields
    ------
    Path
        The folder, in which processes leave their reports.

    Raises
    ------
    InputError
        If the project's folder cannot be written.
    """
    plans = plans_folder()
    try:
        plans.mkdir(parents=True, exist_ok=True)
        remove_leftovers(plans)
        name = f"{partial_name(plan.study)}-" if prefix is None else prefix
        folder = Path(tempfile.mkdtemp(prefix=name, dir=plans))
    except OSError as error:
        raise InputError(
            f"jobs: expected a project folder that can be written for the plan of several processes ({plans}; "
            f"CTUS_HOME names another project), received {error.strerror or error}"
        ) from error
    try:
        plan.write(folder)
        yield folder
    finally:
        remove_plan(folder)


def remove_plan(folder: Path) -> None:
    """Remove the folder of a plan, and the folder of plans with the last of them.

    Parameters
    ----------
    folder : Path
        The folder of the plan.
    """
    shutil.rmtree(folder, ignore_errors=True)
    with contextlib.suppress(OSError):  # another call's plan is there
        folder.parent.rmdir()
