"""The things that a call compares: jobs that differ in folds and seeds alone, and their numbers together."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from experiments.outcome import JobResult
from experiments.running import run_names
from experiments.running.jobs import Job, study_module
from experiments.running.run_job import headline_names
from experiments.tracking.headline import headline

SPREAD = "_std_over_jobs"


@dataclass(frozen=True)
class Variant:
    """One thing that is compared: jobs that differ in folds and seeds alone.

    Parameters
    ----------
    name : str
        What tells it from the others of the call.
    jobs : tuple of Job
        Its jobs.
    """

    name: str
    jobs: tuple[Job, ...]


def hash_of(jobs: Sequence[Job]) -> str:
    """The hash of several jobs: of their own hashes, in any order.

    Parameters
    ----------
    jobs : sequence of Job
        The jobs.

    Returns
    -------
    str
        The hash in hexadecimal.
    """
    return hashlib.sha256("\n".join(sorted(job.hash for job in jobs)).encode()).hexdigest()


def variants_of(jobs: Sequence[Job]) -> list[Variant]:
    """Put the jobs together that differ in folds and seeds alone.

    Parameters
    ----------
    jobs : sequence of Job
        All jobs of a call.

    Returns
    -------
    list of Variant
        The things that are compared, in the order of their first jobs.
    """
    found: dict[tuple[tuple[str, str], ...], list[Job]] = {}
    for job in jobs:
        chosen = sorted(run_names.choices(job).items())
        key = tuple((name, value) for name, value in chosen if name not in run_names.REPETITIONS)
        found.setdefault(key, []).append(job)
    several = len({run_names.subject(job.config) for job in jobs}) > 1
    return [Variant(_name(group[0], several), tuple(group)) for group in found.values()]


def metrics_of(jobs: Sequence[Job], results: Sequence[JobResult]) -> dict[str, float]:
    """The metrics of one thing that is compared, over its folds, seeds or trials.

    These are what the study computes of all of its cases (its function ``over_repeats``); of any other metric the mean
    over the jobs. ``<name>_std_over_jobs`` is the standard deviation over jobs of the first metric that the study has
    chosen for the dashboard.

    Parameters
    ----------
    jobs : sequence of Job
        The jobs, which repeat each other.
    results : sequence of JobResult
        Results of those that finished, at least one.

    Returns
    -------
    dict[str, float]
        Scalars by metric name.
    """
    import numpy as np
    import pandas as pd

    study = str(jobs[0].config["study"])
    module = study_module(study)
    table = pd.DataFrame([dict(result.metrics) for result in results]).astype(float)
    # The mean over folds of what is undefined or infinite in one of them would be that of others.
    means = {str(name): float(table[name].to_numpy().mean()) for name in table.columns}
    pooled: dict[str, float] = {}
    try:
        pooled = dict(module.over_repeats(list(results))) if hasattr(module, "over_repeats") else {}
    except Exception as failure:  # all results are there by now, and nothing of them may be lost
        print(f"{study}: metrics over its jobs are their means alone ({failure})", file=sys.stderr)
    found = {**{name: value for name, value in means.items() if np.isfinite(value)}, **pooled}
    first = next((str(name) for name in (*headline_names(study), *table.columns) if name in table), None)
    values = table[first].to_numpy() if first is not None else np.empty(0)
    if len(values) > 1 and np.isfinite(values).all():
        found[f"{first}{SPREAD}"] = float(np.std(values, ddof=1))
    return found


def shown_metrics(metrics: Mapping[str, float], study: str) -> dict[str, float]:
    """The metrics that the dashboard has columns for, and the standard deviation over jobs if there is one.

    Parameters
    ----------
    metrics : Mapping[str, float]
        All metrics of a run.
    study : str
        Name of its study.

    Returns
    -------
    dict[str, float]
        The chosen ones.
    """
    spread = {name: value for name, value in metrics.items() if name.endswith(SPREAD)}
    rest = {name: value for name, value in metrics.items() if name not in spread}
    return {**headline(rest, headline_names(study)), **spread}


def _name(job: Job, with_subject: bool) -> str:
    parts = [run_names.subject(job.config) if with_subject else "", run_names.thing(job)]
    return ", ".join(part for part in parts if part) or run_names.sweep_name([job])
