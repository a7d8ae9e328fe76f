"""Jobs run again in a project of their own: an empty store, empty caches and a process that nothing was done in before.

``python -m experiments.analysis.runs.rerun <folder>`` runs the jobs in ``points.json`` of the folder, with
the folder as the project.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from experiments import files
from experiments.errors import InputError, user_errors
from experiments.running import jobs, run_sweep, worker
from experiments.running.jobs import Job, Plan
from experiments.running.terminal import TerminalProgress
from experiments.tracking import PARENT_TAG, Store
from experiments.tracking.run_lookup import Family, find_families
from experiments.tracking.store import sqlite_address

COMMAND = (sys.executable, "-P", "-m", "experiments.analysis.runs.rerun")
POINTS, REFUSAL, PRINTED = "points.json", "refusal.txt", "printed.txt"


def run_again(
    points: Sequence[tuple[Mapping[str, Any], str]],
    project: Path,
    *,
    sweep: bool,
    command: Sequence[str] = COMMAND,
) -> Family:
    """Run jobs again with everything in a new project, and read the runs from its store.

    Parameters
    ----------
    points : sequence of (mapping, str)
        Resolved configuration and label of each job.
    project : Path
        Empty folder for the project: its store, its caches and its results.
    sweep : bool
        Whether the jobs are all those of one sweep, which is then summed up as well.
    command : sequence of str, optional
        Command of the process; it gets the folder as its last argument.

    Returns
    -------
    Family
        The run of the sweep with its jobs; of jobs alone, the first with the others.

    Raises
    ------
    InputError
        If a job is refused.
    RuntimeError
        If the process ends before there is a run.
    """
    write_points(points, project, sweep=sweep)
    # A server that the user's own runs go to gets none of these.
    environment = {name: value for name, value in os.environ.items() if name != "MLFLOW_TRACKING_URI"}
    environment["CTUS_HOME"] = str(project)
    with (project / PRINTED).open("w", encoding="utf-8") as printed:
        ended = subprocess.run([*command, str(project)], env=environment, stdout=printed, check=False)
    return runs_of(project, ended.returncode)


def write_points(points: Sequence[tuple[Mapping[str, Any], str]], project: Path, *, sweep: bool) -> None:
    """Write jobs for the process that runs them in a project.

    Parameters
    ----------
    points : sequence of (mapping, str)
        Resolved configuration and label of each; where results go and how they are tracked is replaced.
    project : Path
        Folder of the project.
    sweep : bool
        Whether they are all jobs of one sweep.
    """
    own = {
        "out": str(project / "out"),
        "resume": False,
        "dry_run": False,
        "launcher": {"kind": "local"},
        "tracking": {"uri": None, "enabled": True},
    }
    content = {"sweep": sweep, "points": [[{**config, **own}, label] for config, label in points]}
    files.write_text(project / POINTS, json.dumps(content))


def runs_of(project: Path, code: int) -> Family:
    """Read the runs that a finished process has left in its project.

    Parameters
    ----------
    project : Path
        Folder of the project.
    code : int
        Exit code of the process.

    Returns
    -------
    Family
        The run of the sweep with its jobs; of jobs alone, the first with the others.

    Raises
    ------
    InputError
        If it was refused.
    RuntimeError
        If it ended before there was a run.
    """
    if (refusal := project / REFUSAL).is_file():
        raise InputError(refusal.read_text(encoding="utf-8"))
    database = project / "mlruns" / "ctus.db"
    store = Store(uri=sqlite_address(database))
    runs = list(store.runs()) if database.is_file() else []
    tops = find_families([run.info.run_id for run in runs if PARENT_TAG not in run.data.tags], store)
    if not tops:
        raise RuntimeError(f"the process that ran the jobs again ended with exit code {code} and left no run")
    others = [record for each in tops[1:] for record in (each.run, *each.below)]
    return Family(tops[0].run, (*tops[0].below, *others))


def main(arguments: Sequence[str]) -> int:
    """Run the jobs of a project.

    Parameters
    ----------
    arguments : sequence of str
        Folder of the project.

    Returns
    -------
    int
        Exit code: 0 all is well, 1 a job failed, 2 what was asked is refused.
    """
    project = Path(arguments[0])
    content = json.loads((project / POINTS).read_text(encoding="utf-8"))
    points = [(config, label) for config, label in content["points"]]
    try:
        return run_sweep.run(points) if content["sweep"] else _run_alone(points, project)
    except user_errors() as refusal:
        files.write_text(project / REFUSAL, str(refusal))
        return 2


def _run_alone(points: Sequence[tuple[dict[str, Any], str]], project: Path) -> int:
    """Run each configuration as one job, which a study need not find again among those that it plans."""
    planned = [Job(config, jobs.hash_now(config), label) for config, label in points]
    plan = Plan(str(points[0][0]["study"]), {job.hash: job.label for job in planned}, str(project / "out"))
    with worker.stoppable():
        reports = [worker.run_one(job, plan, TerminalProgress())[0] for job in planned]
    refused = next((report.message for report in reports if report.status == "refused"), None)
    if refused is not None:
        raise InputError(refused)
    return int(any(report.status == "failed" for report in reports))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
