"""The sweep runner: plan all jobs, check them before the first starts, run them, sum them up."""

from __future__ import annotations

import dataclasses
import hashlib
import os
import shutil
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from experiments import files
from experiments.errors import InputError
from experiments.outcome import JobResult, Outcome
from experiments.running import jobs, local_processes, run_job, terminal
from experiments.running.jobs import Job, Plan
from experiments.running.run_job import Report
from experiments.tracking import HASH_TAG, RunWriter, Store

# How the processes that a launcher starts find the plan of the sweep they belong to.
PLAN_FOLDER = "CTUS_PLAN_FOLDER"
SweepPoints = list[tuple[Mapping[str, Any], str]]
# What one call has one of, for all of its jobs.
OF_THE_CALL = ("study", "out", "jobs", "tracking")


def run(points: SweepPoints, launch: Callable[[], object] | None) -> int:
    """Run every job of ``points`` (configuration and label of each) and return the process's exit code.

    ``launch`` starts the jobs through a launcher that calls ``run_sweep_point`` for each point; without it they
    run here, one after the other, or with ``jobs`` above 1 in as many processes at a time.
    0: all is well; 1: a job failed; 2: the user's input is at fault.
    """
    _require_one_call(points)
    study = str(points[0][0]["study"])
    at_once = jobs_at_once(points[0][0])
    contents: dict[str, str] = {}
    planned = jobs.jobs_of(points, contents)
    for job in planned:
        jobs.check(job.config)
    sweep_hash = hashlib.sha256("\n".join(sorted(job.hash for job in planned)).encode()).hexdigest()
    out = jobs.out_folder(points[0][0], sweep_hash)
    store = store_of(points[0][0])
    tracked = run_job.is_tracked(study, store)
    if tracked:
        for run_id in store.mark_orphans_failed(study):
            print(
                f"Run {run_id} was still marked as running, but its process is gone: set to FAILED.",
                file=sys.stderr,
            )
    with stoppable(), _plan_folder() as folder:
        parent = _parent(store, points, planned, sweep_hash) if tracked and len(planned) > 1 else None
        plan = Plan(
            study,
            {job.hash: job.label for job in planned},
            str(out),
            parent.run_id if parent else None,
            contents,
        )
        plan.write(folder / "plan.json")
        try:
            if launch is None and min(at_once, len(planned)) > 1:
                outcome = None
                local_processes.run_in_processes(planned, plan, folder, at_once)
                if tracked:
                    store.mark_orphans_failed(study)  # the runs of processes that were killed
            else:
                outcome = _run_all(points, launch)
            code = _close(planned, plan, store, parent, outcome, _reports(folder, planned))
        except BaseException:
            if parent is not None:
                parent.end("FAILED")
            raise
    return code


def run_sweep_point(config: Mapping[str, Any]) -> Outcome | None:
    """Run the jobs of one point of the sweep that is under way; write a report of each. Returns the last outcome."""
    folder = Path(os.environ[PLAN_FOLDER])
    plan = Plan.read(folder / "plan.json")
    progress = terminal.TerminalProgress()
    outcome = None
    # By what the inputs were when the call began: the plan knows no other hashes.
    for job in jobs.jobs_of([(config, "")], dict(plan.contents)):
        outcome = run_one(Job(job.config, job.hash, plan.labels[job.hash]), plan, folder, progress)
    return outcome


def run_one(job: Job, plan: Plan, folder: Path, progress: terminal.TerminalProgress) -> Outcome | None:
    """Run one job of a plan, say what went wrong, and leave a report of it in ``folder``."""
    alone = len(plan.labels) == 1
    if not alone:
        number = list(plan.labels).index(job.hash) + 1
        progress.note(f"{plan.study}: {job.label} ({number} of {len(plan.labels)})")
    report, outcome = run_job.run_job(job, plan, store_of(job.config), progress)
    report.write(run_job.report_file(folder, job.hash))
    if report.message:
        print(
            report.message if alone else f"{job.label or plan.study}: {report.message}",
            file=sys.stderr,
        )
    return outcome


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
    """How many jobs of a call run at the same time; InputError if ``jobs`` is not a whole number from 1."""
    at_once = config.get("jobs", 1)
    if isinstance(at_once, bool) or not isinstance(at_once, int) or at_once < 1:
        raise InputError(f"jobs: expected a whole number from 1, received {at_once!r}")
    return at_once


def store_of(config: Mapping[str, Any]) -> Store:
    """The tracker that a configuration names."""
    return Store(**config["tracking"])


def _run_all(points: SweepPoints, launch: Callable[[], object] | None) -> Outcome | None:
    if launch is not None:
        launch()
        return None
    outcome = None
    for config, _ in points:
        outcome = run_sweep_point(config)
    return outcome


def _close(
    planned: list[Job],
    plan: Plan,
    store: Store,
    parent: RunWriter | None,
    alone: Outcome | None,
    reports: dict[str, Report],
) -> int:
    """Sum up the finished jobs, end the parent run, print the last lines and return the exit code."""
    ended = [(job, reports.get(job.hash)) for job in planned]
    good = [(job, report) for job, report in ended if report and report.status in ("finished", "resumed")]
    results = [run_job.load_result(report, job, store) for job, report in good]
    outcome = alone if len(planned) == 1 and alone is not None else _summary(plan.study, results)
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
        return 0
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


def _reports(folder: Path, planned: list[Job]) -> dict[str, Report]:
    paths = {job.hash: run_job.report_file(folder, job.hash) for job in planned}
    return {key: Report.read(path) for key, path in paths.items() if path.is_file()}


@contextmanager
def _plan_folder() -> Iterator[Path]:
    folder = Path(tempfile.mkdtemp(prefix="ctus-sweep-"))
    os.environ[PLAN_FOLDER] = str(folder)
    try:
        yield folder
    finally:
        del os.environ[PLAN_FOLDER]
        shutil.rmtree(folder, ignore_errors=True)


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
