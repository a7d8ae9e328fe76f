"""The runs of a call in the tracker: the sweep, each thing that is compared, and its folds, seeds or trials."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from experiments.masking import masked
from experiments.outcome import InputData, JobResult, Outcome
from experiments.running import cost, run_names
from experiments.running.jobs import Job
from experiments.running.run_job import (
    Report,
    headline_names,
    keep_for_later,
    log_beginning,
    log_results,
    read_inputs,
    source_tags,
)
from experiments.running.terminal import markdown
from experiments.running.variants import Variant, hash_of, metrics_of, shown_metrics, variants_of
from experiments.tracking import HASH_TAG, METRICS_FILE, PARENT_TAG, RunWriter, Store, origin_of
from experiments.tracking.headline import (
    LEVEL_TAG,
    NOTE_TAG,
    REPEAT,
    RESULT,
    SWEEP,
    description,
    metrics_text,
)
from experiments.tracking.run_record import resumed_tags

# The jobs of a call with what became of each: its report and its result, or none.
Ended = Sequence[tuple[Job, Report | None, JobResult | None]]


@dataclass
class SweepRuns:
    """Runs of a call that stand above those of its jobs.

    Parameters
    ----------
    sweep : RunWriter or None, optional
        The run of the whole call; None for a single job or without a tracker.
    single : bool, optional
        Whether the call compares nothing: its jobs are folds and seeds of one thing.
    variants : list of tuple of Variant and RunWriter, optional
        Runs of the things that are compared, where a thing has several jobs.
    parents : dict[str, str], optional
        Id of the run above each job, by the job's hash.
    levels : dict[str, str], optional
        ``result`` or ``repeat``, by the job's hash.
    resumed : bool, optional
        Whether the run of the call was there before.
    store : Store or None, optional
        The tracker.
    folder : Path, optional
        Folder for the results of the call.
    """

    sweep: RunWriter | None = None
    single: bool = False
    variants: list[tuple[Variant, RunWriter]] = field(default_factory=list)
    parents: dict[str, str] = field(default_factory=dict)
    levels: dict[str, str] = field(default_factory=dict)
    resumed: bool = False
    store: Store | None = None
    folder: Path = Path()

    def log_summary(
        self,
        jobs: Sequence[Job],
        results: Sequence[JobResult],
        outcome: Outcome,
        folder: Path,
        names: Sequence[str],
    ) -> None:
        """Log the summary of all jobs on the run of the call.

        Its metrics are those of the one thing that was measured; where several were, none, as they would mix them.

        Parameters
        ----------
        jobs : sequence of Job
            All jobs of the call.
        results : sequence of JobResult
            Results of those that finished.
        outcome : Outcome
            The summary.
        folder : Path
            Folder of its files.
        names : sequence of str
            Names of the files, from that folder on.
        """
        if self.sweep is None:
            return
        study = str(jobs[0].config["study"])
        metrics = shown_metrics(metrics_of(jobs, results), study) if self.single else {}
        tables = markdown(dict(outcome.tables))
        note = description(outcome.findings, tables, outcome.figures, self.sweep.run_id)
        shown = replace(outcome, metrics=metrics, inputs=_inputs(results), history=())
        log_results(self.sweep, replace(shown, tags={**outcome.tags, NOTE_TAG: note}), folder, names)

    def close(self, ended: Ended) -> None:
        """End all runs, those of the things that are compared with the metrics of their own jobs.

        Runs whose jobs were all refused are withdrawn: what the user got wrong is no run.

        Parameters
        ----------
        ended : sequence of (Job, Report or None, JobResult or None)
            The jobs with what became of each.
        """
        for variant, run in self.variants:
            own = [one for one in ended if one[0].hash in {job.hash for job in variant.jobs}]
            if results := [result for _, _, result in own if result is not None]:
                _log_variant(run, variant, own, results)
            log_results(run, Outcome(tags=self._cost_tags(own)), Path(), ())
            self._end(run, own, variant.name)
        if self.sweep is not None:
            bad = sum(result is None for _, _, result in ended)
            resumed = sum(report is not None and report.status == "resumed" for _, report, _ in ended)
            counts = {"jobs": len(ended), "jobs_failed": bad, "jobs_resumed": resumed}
            tags = {**resumed_tags(self._elsewhere(ended)), **self._cost_tags(ended)}
            log_results(self.sweep, Outcome(metrics=counts, tags=tags), Path(), ())
            self._end(self.sweep, ended, "the sweep")

    def _cost_tags(self, ended: Ended) -> dict[str, str]:
        """What the jobs of a run have cost together, whenever they were run."""
        costs = [self._cost(report) for _, report, _ in ended]
        found = cost.total(costs)
        return {} if found is None else found.tags()

    def _cost(self, report: Report | None) -> cost.Cost | None:
        if report is None or report.status != "resumed" or self.store is None:
            return None if report is None else report.cost
        run = self.store.run(str(report.run_id))
        return None if run is None else cost.of_tags(run.data.tags)

    def _elsewhere(self, ended: Ended) -> list[str]:
        """Runs of jobs that an earlier sweep had finished, which stand below that one, by their first ids."""
        own, found = set(self.parents.values()), []
        for report in (report for _, report, _ in ended if report is not None and report.status == "resumed"):
            run = self.store.run(str(report.run_id)) if self.store is not None else None
            if run is not None and run.data.tags.get(PARENT_TAG) not in own:
                found.append(origin_of(run))
        return found

    def fail(self) -> None:
        """End all runs as FAILED."""
        for run in self._all():
            run.end("FAILED")
            self._keep(run, "a run above the jobs")

    def withdraw(self) -> None:
        """Take the runs back of a call that was refused before a job of it began; those of an earlier call fail."""
        for run in self._all():
            if self.resumed:
                run.end("FAILED")
                self._keep(run, "a run above the jobs")
            else:
                run.withdraw()

    def _all(self) -> list[RunWriter]:
        return [run for _, run in self.variants] + ([self.sweep] if self.sweep else [])

    def _end(self, run: RunWriter, ended: Ended, name: str) -> None:
        refused = all(report is not None and report.status == "refused" for _, report, _ in ended)
        if refused and not self.resumed:
            run.withdraw()
        else:
            run.end("FINISHED" if all(result is not None for _, _, result in ended) else "FAILED")
            self._keep(run, name)

    def _keep(self, run: RunWriter, name: str) -> None:
        if self.store is not None:
            keep_for_later(run, self.store.undelivered, self.folder / "untracked", name)


def open_runs(store: Store, jobs: Sequence[Job], folder: Path = Path()) -> SweepRuns:
    """Begin the runs above the jobs of a call, or go on with those of the same sweep where ``resume`` asks for it.

    Parameters
    ----------
    store : Store
        The tracker.
    jobs : sequence of Job
        All jobs of the call.
    folder : Path, optional
        Folder for the results of the call.

    Returns
    -------
    SweepRuns
        The runs; of a single job there are none.
    """
    study = str(jobs[0].config["study"])
    store.save_view(study, run_names.main_parameters(jobs), headline_names(study))
    if len(jobs) == 1:
        return SweepRuns(levels={jobs[0].hash: RESULT})
    variants = variants_of(jobs)
    single = len(variants) == 1
    known = _known(store, jobs, "sweep") if jobs[0].config.get("resume") else None
    sweep = _opened(store, jobs, run_names.sweep_name(jobs), "sweep", RESULT if single else SWEEP, known)
    runs = SweepRuns(sweep, single, resumed=known is not None, store=store, folder=folder)
    for variant in variants:
        above, repeated = sweep.run_id, len(variant.jobs) > 1
        if repeated and not single:
            before = _known(store, variant.jobs, "variant", above) if runs.resumed else None
            run = _opened(store, variant.jobs, variant.name, "variant", RESULT, before, above)
            runs.variants.append((variant, run))
            above = run.run_id
        runs.parents |= {job.hash: above for job in variant.jobs}
        runs.levels |= {job.hash: REPEAT if repeated else RESULT for job in variant.jobs}
    return runs


def _known(store: Store, jobs: Sequence[Job], kind: str, parent_id: str | None = None) -> str | None:
    """The run above these jobs that an earlier call began and no other is at."""
    study = str(jobs[0].config["study"])
    for run in store.runs([study], f"tags.`{HASH_TAG}` = '{hash_of(jobs)}' and tags.`ctus.kind` = '{kind}'"):
        if not store.is_under_way(run) and parent_id in (None, run.data.tags.get(PARENT_TAG)):
            return str(run.info.run_id)
    return None


def _opened(
    store: Store,
    jobs: Sequence[Job],
    name: str,
    kind: str,
    level: str,
    known: str | None,
    parent_id: str | None = None,
) -> RunWriter:
    """Begin a run above some jobs with what they share, or go on with a known one."""
    if known is not None:
        return store.reopen(known)
    first = jobs[0].config
    tags = {HASH_TAG: hash_of(jobs), "ctus.kind": kind, LEVEL_TAG: level, **source_tags(first)}
    run = store.start(str(first["study"]), name, tags, parent_id)
    alike = {key: value for key, value in first.items() if _alike(jobs, key, value)}
    each = [run_names.parameters(job) for job in jobs]
    log_beginning(run, alike, run_names.shared_parameters(each, listed=level == SWEEP))
    return run


def _alike(jobs: Sequence[Job], key: str, value: object) -> bool:
    return all(job.config.get(key) == value for job in jobs)


def _inputs(results: Sequence[JobResult]) -> tuple[InputData, ...]:
    """The data sets that jobs used, each once."""
    return tuple(dict.fromkeys(data for result in results for data in read_inputs(result.workspace)))


def _log_variant(run: RunWriter, variant: Variant, own: Ended, results: Sequence[JobResult]) -> None:
    metrics = metrics_of(variant.jobs, results)
    shown = shown_metrics(metrics, str(variant.jobs[0].config["study"]))
    note = description([], _table(own, variant, shown))
    outcome = Outcome(metrics=shown, tags={NOTE_TAG: note}, inputs=_inputs(results))
    log_results(run, outcome, Path(), ())
    try:
        run.text(metrics_text(metrics), METRICS_FILE)
    except Exception as refusal:
        run.refused.append(METRICS_FILE)
        print(masked(f"The tracker refused {METRICS_FILE}: {str(refusal).splitlines()[0]}"), file=sys.stderr)


def _table(own: Ended, variant: Variant, shown: Mapping[str, float]) -> str:
    """The jobs of one thing, a row each, and what they make together."""
    import pandas as pd

    rows = [
        {"run": run_names.job_name(job, with_subject=False)}
        | {name: float(result.metrics[name]) for name in shown if name in result.metrics}
        for job, _, result in own
        if result is not None
    ]
    rows.append({"run": "together", **shown})
    return markdown({variant.name: pd.DataFrame(rows)})
