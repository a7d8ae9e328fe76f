"""The numbers of one model on one data set: summaries of every score, and the bounds of what is stated."""

from __future__ import annotations

from typing import TYPE_CHECKING

from experiments.analysis.segmentation.case_table import distances, groups, once_each, place_of, scores, seeds
from experiments.statistics import Bootstrap, wilson_of_rate
from models.metrics.scoring import summarise

if TYPE_CHECKING:
    import pandas as pd

RATES = ("missed", "false_alarm")


def pooled_metrics(cases: pd.DataFrame) -> dict[str, float]:
    """Summarise every score over all cases; with several models or data sets, each under its own name.

    A case counts once, by its mean over seeds. ``<score>_ci_low`` and ``_ci_high`` are the bootstrap 95 %
    interval of the mean over groups, ``<rate>_rate_low`` and ``_high`` Wilson's; ``dsc_seed_std`` is the
    standard deviation over seeds of the mean. Each is present only if it is defined: an interval needs two
    groups.

    Parameters
    ----------
    cases : pandas.DataFrame
        Per-case table, as ``pool`` gives it.

    Returns
    -------
    dict
        Scalars by the name of the metric, after ``<model>/<dataset>/`` if there are several.
    """
    parts = list(groups(cases))
    metrics: dict[str, float] = {}
    for model, label, group in parts:
        place = f"{model}/{place_of(label)}/" if len(parts) > 1 else ""
        metrics |= {f"{place}{key}": value for key, value in bounded_summary(group).items()}
    return metrics


def plain_summary(cases: pd.DataFrame) -> dict[str, float]:
    """Summarise every score of one model on one data set, each case once, without intervals.

    Parameters
    ----------
    cases : pandas.DataFrame
        Per-case table of one model and data set.

    Returns
    -------
    dict
        Scalars by the name of the metric.
    """
    each = once_each(cases)
    return summarise({name: each[name] for name in scores(cases)})


def bounded_summary(cases: pd.DataFrame) -> dict[str, float]:
    """Summarise every score of one model on one data set, with intervals.

    Parameters
    ----------
    cases : pandas.DataFrame
        Per-case table of one model and data set.

    Returns
    -------
    dict
        Scalars by the name of the metric; bounds that are not defined are absent.
    """
    each, numbers = once_each(cases), plain_summary(cases)
    for score in ("dsc", *distances(cases)):
        defined = each[each[score].notna()]
        if not len(defined):
            continue
        interval = Bootstrap("mean_of_cases")(defined[score], defined["group"].tolist())
        if interval.units > 1:
            numbers |= {f"{score}_ci_low": interval.low, f"{score}_ci_high": interval.high}
    for name in RATES:
        if f"{name}_rate" in numbers:
            rate = wilson_of_rate(numbers[f"{name}_rate"], int(numbers[f"{name}_n"]))
            numbers |= {f"{name}_rate_low": rate.low, f"{name}_rate_high": rate.high}
    if len(seeds(cases)) > 1:
        numbers["dsc_seed_std"] = float(cases.groupby("seed")["dsc"].mean().std())
    return numbers


def unpenalised(cases: pd.DataFrame) -> list[str]:
    """List the columns of the HD95 without penalty, in the unit of each penalised one that the cases have.

    Parameters
    ----------
    cases : pandas.DataFrame
        Per-case table.

    Returns
    -------
    list of str
        Names of the columns that hold a number, mm first.
    """
    return [
        name
        for name in ("hd95_unpenalised_mm", "hd95_unpenalised_px")
        if name in cases and cases[name].notna().any()
    ]
