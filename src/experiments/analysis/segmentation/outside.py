"""Scores of the cases outside all folds: never pooled with the cases that the folds leave out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from experiments.analysis.segmentation.case_table import groups, in_part, pool
from experiments.analysis.segmentation.summary import bounded_summary, plain_summary
from experiments.outcome import JobResult
from experiments.splits.split import OUTSIDE

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["OUTSIDE", "outside_metrics", "outside_table"]
SHOWN = ("dsc_mean", "hd95_mm_mean", "hd95_px_mean", "missed_rate", "false_alarm_rate")
BOUNDS = ("dsc_ci_low", "dsc_ci_high")


def outside_metrics(cases: pd.DataFrame) -> dict[str, float]:
    """Summarise the scores of one fold on the cases outside all folds.

    Parameters
    ----------
    cases : pandas.DataFrame
        Per-case table of the job, with a column ``part``.

    Returns
    -------
    dict
        ``<part>_dsc_mean`` and its like, where there are such cases.
    """
    numbers = {part: plain_summary(in_part(cases, part)) for part in OUTSIDE if len(in_part(cases, part))}
    return {
        f"{part}_{name}": found[name] for part, found in numbers.items() for name in SHOWN if name in found
    }


def outside_table(results: Sequence[JobResult]) -> dict[str, pd.DataFrame]:
    """Tabulate the scores on the cases outside all folds, each case by its mean over the folds' networks.

    Parameters
    ----------
    results : sequence of JobResult
        Results of all jobs of the sweep.

    Returns
    -------
    dict of str to pandas.DataFrame
        ``outside all folds``: a row for each model, data set and part; empty where no group was set aside.
    """
    import pandas as pd

    rows = []
    for part in OUTSIDE:
        if not any(result.cases is not None and len(in_part(result.cases, part)) for result in results):
            continue
        for model, label, cases in groups(pool(results, part=part)):
            numbers = bounded_summary(cases)
            about = {"model": model, "dataset": label, "part": part, "cases": cases["case_id"].nunique()}
            rows.append(about | {name: numbers[name] for name in (*SHOWN, *BOUNDS) if name in numbers})
    return {"outside all folds": pd.DataFrame(rows)} if rows else {}
