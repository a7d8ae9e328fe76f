"""What a call would do and cost, without doing it: its jobs, which have finished, how long earlier ones took.

Nothing is started and nothing is written to the tracker. A price is the median time of earlier runs in the tracker, of
the closest kind that there is; where there is none, it is unknown, not guessed.
"""

from __future__ import annotations

import dataclasses
import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from experiments.reporting.labels import counted
from experiments.running import run_job, run_names, terminal
from experiments.running.jobs import Job
from experiments.tracking import HASH_TAG, Store

# The newest runs tell more of the code and the machine as they are now.
NEWEST = 20
AGAIN = "runs again"
# Parameters that decide most of what a job costs, for jobs that have no closer runs.
_COSTLY = (*run_names.METHODS, "budget")


@dataclass(frozen=True)
class EarlierRun:
    """A finished run of the study.

    Parameters
    ----------
    hash : str
        Hash of its job.
    params : mapping of str to str
        Parameters that the dashboard has columns for.
    seconds : float
        Time that it took in s.
    """

    hash: str
    params: Mapping[str, str]
    seconds: float


@dataclass(frozen=True)
class Price:
    """What a job will cost.

    Parameters
    ----------
    job : Job
        The job.
    state : str
        ``finished`` (and skipped), ``runs again`` or ``to run``.
    seconds : float
        Expected time in s: 0 for a job that is skipped, NaN where nothing is known.
    source : str
        What the expectation comes from.
    """

    job: Job
    state: str
    seconds: float
    source: str


def show(planned: Sequence[Job], store: Store, at_once: int) -> None:
    """Print what a call would do and cost.

    Parameters
    ----------
    planned : sequence of Job
        Jobs of the call, which are checked already.
    store : Store
        The tracker.
    at_once : int
        Number of jobs at the same time.
    """
    import pandas as pd

    prices = priced(planned, earlier_runs(str(planned[0].config["study"]), store))
    rows = pd.DataFrame(
        {
            "job": [price.job.label or str(price.job.config["study"]) for price in prices],
            "state": [price.state for price in prices],
            "expected_s": [
                "unknown" if math.isnan(price.seconds) else f"{price.seconds:.0f}" for price in prices
            ],
            "from": [price.source for price in prices],
        }
    )
    terminal.print_tables({"Jobs": rows})
    print(summary(prices, at_once))
    print("Nothing was started (dry_run=true).")


def earlier_runs(study: str, store: Store) -> list[EarlierRun]:
    """Read the finished jobs of a study from the tracker, which stays as it is.

    Parameters
    ----------
    study : str
        Name of the study.
    store : Store
        The tracker.

    Returns
    -------
    list of EarlierRun
        The runs, newest first; none where nothing is tracked.
    """
    if not (run_job.is_tracked(study, store) and store.exists):
        return []
    wanted = "attributes.status = 'FINISHED' and tags.`ctus.kind` = 'job'"
    return [
        EarlierRun(
            run.data.tags.get(HASH_TAG, ""),
            dict(run.data.params),
            (run.info.end_time - run.info.start_time) / 1000,
        )
        for run in dataclasses.replace(store, reads_only=True).runs([study], wanted)
        if run.info.end_time
    ]


def priced(planned: Sequence[Job], earlier: Sequence[EarlierRun]) -> list[Price]:
    """Price every job.

    Parameters
    ----------
    planned : sequence of Job
        Jobs of a call.
    earlier : sequence of EarlierRun
        Finished runs of the study, newest first.

    Returns
    -------
    list of Price
        The prices, in the order of the jobs.
    """
    done = {run.hash for run in earlier}
    found = []
    for job in planned:
        if job.hash in done and job.config.get("resume"):
            found.append(Price(job, "finished", 0.0, "has a finished run"))
            continue
        state = AGAIN if job.hash in done else "to run"
        seconds, source = _expected(job, earlier)
        found.append(Price(job, state, seconds, source))
    return found


def summary(prices: Sequence[Price], at_once: int) -> str:
    """Sum up what a call will cost.

    Parameters
    ----------
    prices : sequence of Price
        Prices of its jobs.
    at_once : int
        Number of jobs at the same time.

    Returns
    -------
    str
        A sentence.
    """
    to_run = [price for price in prices if price.state != "finished"]
    known = [price.seconds for price in to_run if not math.isnan(price.seconds)]
    again = sum(price.state == AGAIN for price in to_run)
    note = f" ({again} of them had finished: resume=true skips these)" if again else ""
    parts = [
        f"{counted(len(prices), 'job')}: {len(prices) - len(to_run)} finished, {len(to_run)} to run{note}"
    ]
    if known:
        together = max(sum(known) / at_once, *known)
        parts.append(f"about {sum(known):.0f} s of jobs, {together:.0f} s with {at_once} at a time")
    if unknown := len(to_run) - len(known):
        parts.append(f"the time of {unknown} unknown")
    return "; ".join(parts) + "."


def _expected(job: Job, earlier: Sequence[EarlierRun]) -> tuple[float, str]:
    """The median time of the closest earlier runs, and which they are."""
    own = run_names.parameters(job)
    costly = {name: own[name] for name in _COSTLY if name in own}
    kinds = [
        ("this very job", [run for run in earlier if run.hash == job.hash]),
        (
            "the same settings",
            [run for run in earlier if _without_repeats(run.params) == _without_repeats(own)],
        ),
        (
            f"{', '.join(costly.values())} with other settings (rough)",
            [run for run in earlier if costly and costly.items() <= dict(run.params).items()],
        ),
    ]
    for kind, runs in kinds:
        if runs:
            seconds = [run.seconds for run in runs[:NEWEST]]
            number = "1 run" if len(seconds) == 1 else f"median of {len(seconds)} runs"
            return statistics.median(seconds), f"{number} of {kind}"
    return math.nan, "no earlier run"


def _without_repeats(params: Mapping[str, str]) -> dict[str, str]:
    return {name: value for name, value in params.items() if name not in run_names.REPETITIONS}
