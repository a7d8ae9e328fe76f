"""The sweep runner: plan all jobs, check them before the first starts, run them, sum them up."""

from __future__ import annotations

import dataclasses
import hashlib
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from experiments import files
from experiments.errors import InputError
from experiments.outcome import JobResult, Outcome
from experiments.running import jobs, run_job, terminal
from experiments.running.jobs import Job, Plan
from experiments.running.launcher import InProcess, Launched, Launcher
from experiments.running.local_processes import LocalProcesses
from experiments.running.worker import stoppable, store_of
from experiments.tracking import HASH_TAG, RunWriter, Store

SweepPoints = list[tuple[Mapping[str, Any], str]]
# What one call has one of, for all of its jobs.
OF_THE_CALL = ("study", "out", "jobs", "tracking")


def run(points: SweepPoints) -> int:
    """Run every job of a call and return the process's exit code.

    With ``jobs`` above 1 in the configuration the jobs run in as many processes at a time, else one after the other in
    this one.

    Parameters
    ----------
    points : list of (mapping, str)
        The sweep points: the resolved configuration and the label of each.

    Returns
    -------
    int
        0: all is well; 1: a job failed; 2: the user's input is at fault.

    Raises
    ------
    InputError
        If the points differ in what a call has only one of, or a job is known to be wrong before it starts.
    """
    _require_one_call(points)
    at_once = jobs_at_once(points[0][0])
    study = str(points[0][0]["study"])
    contents: dict[str, str] = {}
    planned = jobs.jobs_of(points, contents)
    for job in planned:
        jobs.check(job.config)
    launcher = launcher_of(min(at_once, len(planned)))
    sweep_hash = hashlib.sha256("\n".join(sorted(job.hash for job in planned)).encode()).hexdigest()
    out = jobs.out_folder(points[0][0], sweep_hash)
    store = store_of(points[0][0])
    tracked = run_job.is_tracked(study, store)
    if tracked:
        _mark_orphans_failed(store, study)
    with stoppable():
        parent = _parent(store, points, planned, sweep_hash) if tracked and len(planned) > 1 else None
        labels = {job.hash: job.label for job in planned}
        plan = Plan(study, labels, str(out), parent.run_id if parent else None, contents)
        try:
            launched = launcher.run(planned, plan)
            if tracked and not isinstance(launcher, InProcess):
                store.mark_orphans_failed(study)  # the runs of processes that were killed
            return _close(planned, plan, store, parent, launched)
        except BaseException:
            if parent is not None:
                parent.end("FAILED")
            raise


def launcher_of(at_once: int) -> Launcher:
    """Choose how the jobs of a call are started.

    Parameters
    ----------
    at_once : int
        Number of jobs at the same time.

    Returns
    -------
    Launcher
        ``LocalProcesses`` if more than one job may run at a time, else ``InProcess``.
    """
    return LocalProcesses(at_once) if at_once > 1 else InProcess()


def _mark_orphans_failed(store: Store, study: str) -> None:
    for run_id in store.mark_orphans_failed(study):
        print(
            f"Run {run_id} was still marked as running, but its process is gone: set to FAILED.",
            file=sys.stderr,
        )


def _require_one_call(points: SweepPoints) -> None:
    """Raise InputError if the points of a sweep differ in what a call has only one of."""
    first = points[0][0]
    for name in OF_THE_CALL:
        other = next((config for config, _ in points if config.get(name) != first.get(name)), None)
        if other is not None:
            raise InputError(
                f"{name}: expected one value for all jobs of a call, received {first.get(name)!r} and "
                f"{other.get(name)!r}; give each a call of its own"
            )


def jobs_at_once(config: Mapping[str, Any]) -> int:
    """How many jobs of a call run at the same time; InputError if ``jobs`` is not a whole number from 1.

    Parameters
    ----------
    config : Mapping[str, Any]
        A resolved configuration.

    Returns
    -------
    int
        Number of jobs.
    """
    at_once = config.get("jobs", 1)
    if isinstance(at_once, bool) or not isinstance(at_once, int) or at_once < 1:
        raise InputError(f"jobs: expected a whole number from 1, received {at_once!r}")
    return at_once


def _close(
    planned: list[Job],
    plan: Plan,
    store: Store,
    parent: RunWriter | None,
    launched: Launched,
) -> int:
    """Sum up the finished jobs, end the parent run, print the last lines and return the exit code."""
    ended = [(job, launched.reports.get(job.hash)) for job in planned]
    good = [(job, report) for job, report in ended if report and report.status in ("finished", "resumed")]
    results = [run_job.load_result(report, job, store) for job, report in good]
    outcome = launched.outcome if launched.outcome is not None else _summary(plan.study, results)
    out = Path(plan.out)
    if len(planned) > 1 and results:
        with files.staged(out) as stage:
            run_job.write_outcome(outcome, stage)
            written = files.names_in(stage)
        if parent is not None:
            over = {**_over_jobs(results, outcome.metrics), **outcome.metrics}
            run_job.log_results(parent, dataclasses.replace(outcome, metrics=over), out, written)
    bad = [(job, report) for job, report in ended if report is None or report.status in ("refused", "failed")]
    if parent is not None:
        resumed = sum(report.status == "resumed" for _, report in good)
        counts = {"jobs": len(planned), "jobs_failed": len(bad), "jobs_resumed": resumed}
        run_job.log_results(parent, Outcome(metrics=counts), out, ())
        parent.end("FAILED" if bad else "FINISHED")
    if results:
        terminal.print_tables(dict(outcome.tables))
        dashboard = store.dashboard if run_job.is_tracked(plan.study, store) else None
        terminal.print_closing(outcome.findings, out, dashboard)
    if bad and len(planned) > 1:
        names = "; ".join(job.label for job, _ in bad)
        print(
            f"{len(bad)} of {len(planned)} jobs did not finish: {names}. resume=true runs these again.",
            file=sys.stderr,
        )
    if not bad:
        # What a job left out is the user's input at fault, though all else was done.
        return 2 if any(report.refused for _, report in good) else 0
    return 2 if all(report is not None and report.status == "refused" for _, report in bad) else 1


def _summary(study: str, results: list[JobResult]) -> Outcome:
    summarise = getattr(jobs.study_module(study), "summarise", None)
    return summarise(results) if summarise is not None and results else Outcome()


def _over_jobs(results: list[JobResult], known: Mapping[str, float]) -> dict[str, float]:
    """Mean and standard deviation over the jobs of every metric that the summary does not give itself."""
    import numpy as np
    import pandas as pd

    table = pd.DataFrame([dict(result.metrics) for result in results]).astype(float)
    over: dict[str, float] = {}
    for name in table.columns:
        finite = table[name][np.isfinite(table[name])]
        mean, std = float(finite.mean()), float(finite.std(ddof=1))
        if name not in known and mean == mean:
            over[name] = mean
        if std == std:
            over[f"{name}_std_over_jobs"] = std
    return over


def _parent(store: Store, points: SweepPoints, planned: list[Job], sweep_hash: str) -> RunWriter:
    """The run above all jobs: a new one, or with ``resume=true`` the one of the same sweep."""
    config = points[0][0]
    study = str(config["study"])
    if config.get("resume"):
        known = store.runs([study], f"tags.`{HASH_TAG}` = '{sweep_hash}'")
        if (found := next((run for run in known if not store.is_under_way(run)), None)) is not None:
            return store.reopen(found.info.run_id)
    run_ = store.start(study, f"{study} ({len(planned)} jobs)", {HASH_TAG: sweep_hash, "ctus.kind": "sweep"})
    shared = {
        key: value for key, value in config.items() if all(point.get(key) == value for point, _ in points)
    }
    run_job.log_config(run_, shared)
    return run_
