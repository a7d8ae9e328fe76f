"""The sweep runner: plan all jobs, check them before the first starts, run them, sum them up."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from experiments import files
from experiments.errors import InputError, user_errors
from experiments.masking import masked
from experiments.outcome import JobResult, Outcome
from experiments.running import dry_run, jobs, launcher_choice, run_job, run_names, terminal
from experiments.running.jobs import Job, Plan
from experiments.running.launcher import InProcess, Launched
from experiments.running.sweep_runs import SweepRuns, open_runs
from experiments.running.variants import hash_of
from experiments.running.worker import stoppable, store_of
from experiments.tracking import ServerAwayError, Store
from experiments.tracking.undelivered import deliver

SweepPoints = list[tuple[Mapping[str, Any], str]]
# What one call has one of, for all of its jobs.
OF_THE_CALL = ("study", "out", "jobs", "launcher", "dry_run", "tracking")


def run(points: SweepPoints) -> int:
    """Run every job of a call and return the process's exit code.

    How the jobs are started, and where, ``launcher`` and ``jobs`` of the configuration say. With ``dry_run`` none is:
    all is checked, and what each job will cost is printed.

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
    launcher_choice.require_known(points[0][0])
    study = str(points[0][0]["study"])
    jobs.check_points(points)
    contents: dict[str, str] = {}
    planned = jobs.jobs_of(points, contents)
    launcher = launcher_choice.launcher_of(points[0][0], planned)
    out = jobs.out_folder(points[0][0], hash_of(planned))
    store = store_of(points[0][0])
    tracked = run_job.is_tracked(study, store)
    if points[0][0].get("dry_run"):
        dry_run.show(planned, store, launcher_choice.at_once(points[0][0], planned))
        return 0
    if store.enabled:
        deliver(store)
    if tracked:
        _begin_tracking(store, study, resume=bool(points[0][0].get("resume")))
    with stoppable():
        runs = open_runs(store, planned, out) if tracked else SweepRuns()
        plan = _plan(study, planned, out, contents, runs)
        try:
            launched = launcher.run(planned, plan)
            if tracked and not isinstance(launcher, InProcess):
                _mark_killed_failed(store, study, launched)
            code = _close(planned, plan, store, runs, launched)
        except user_errors():
            runs.withdraw()
            raise
        except BaseException:
            runs.fail()
            raise
        if tracked:
            deliver(store)
        return code


def _plan(study: str, planned: list[Job], out: Path, contents: dict[str, str], runs: SweepRuns) -> Plan:
    labels = {job.hash: job.label for job in planned}
    # The run above says what all of its jobs are about.
    alone = len(planned) == 1 or len({run_names.subject(job.config) for job in planned}) > 1
    names = {job.hash: run_names.job_name(job, with_subject=alone) for job in planned}
    return Plan(study, labels, str(out), contents, names, runs.parents, runs.levels)


def _begin_tracking(store: Store, study: str, *, resume: bool) -> None:
    """Tidy the tracker; one that is away gets its runs later, unless it has to say what is finished."""
    try:
        _mark_orphans_failed(store, study)
    except ServerAwayError as away:
        if resume:
            raise
        print(
            f"{away}. The call goes on: its runs wait in {store.undelivered} "
            "and are delivered when the server answers.",
            file=sys.stderr,
        )


def _mark_orphans_failed(store: Store, study: str) -> None:
    for run_id in store.mark_orphans_failed(study):
        print(
            f"Run {run_id} was still marked as running, but its process is gone: set to FAILED.",
            file=sys.stderr,
        )


def _mark_killed_failed(store: Store, study: str, launched: Launched) -> None:
    """Mark the runs of processes that were killed; a tracker that refuses this takes no result away."""
    ended = [
        (key, process, report.message or "its process ended before the run did")
        for key, process in launched.processes.items()
        if (report := launched.reports.get(key)) is not None
    ]
    try:
        store.mark_ended_failed(study, ended)
        store.mark_orphans_failed(study)
    except Exception as refusal:
        print(
            masked(f"The tracker refused to mark runs as FAILED: {str(refusal).splitlines()[0]}"),
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


def _close(
    planned: list[Job],
    plan: Plan,
    store: Store,
    runs: SweepRuns,
    launched: Launched,
) -> int:
    """Sum up the finished jobs, end the runs above them, print the last lines and return the exit code."""
    ended = [(job, launched.reports.get(job.hash)) for job in planned]
    good = [(job, report) for job, report in ended if report and report.status in ("finished", "resumed")]
    results = [run_job.load_result(report, job, store) for job, report in good]
    outcome = launched.outcome if launched.outcome is not None else _summary(plan.study, results)
    out = Path(plan.out)
    if len(planned) > 1 and results:
        with files.staged(out) as stage:
            run_job.write_outcome(outcome, stage)
            written = files.names_in(stage)
        runs.log_summary(planned, results, outcome, out, written)
    bad = [(job, report) for job, report in ended if report is None or report.status in ("refused", "failed")]
    known = {job.hash: result for (job, _), result in zip(good, results, strict=True)}
    runs.close([(job, report, known.get(job.hash)) for job, report in ended])
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
