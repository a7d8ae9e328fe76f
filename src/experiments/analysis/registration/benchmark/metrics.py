"""Rates, errors and areas of risk of one method on a benchmark, and which of its results to look at."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from experiments.analysis.registration.pose_scores import judges
from experiments.analysis.registration.risk_coverage import risk_coverage
from experiments.statistics import Bootstrap, Interval, summary, wilson_interval
from registration.rigid.result import ACCEPTED, NOT_JUDGED

if TYPE_CHECKING:
    import pandas as pd

SUMMARISED = ("rmse_mm", "tre_mm", "tre_max_mm", "rotation_error_deg", "translation_error_mm")
# Where tissue deforms: against the true rigid pose, and what that pose itself leaves.
DEFORMED = ("tre_rigid_mm", "lowest_tre_mm")
RIGHT = "success_tre_symmetric"
# The orders in which results are accepted: the larger of these two, the greater the doubt.
DOUBTS = {"tre_high_mm": 1.0, "ambiguity_gap": -1.0}


def benchmark_metrics(cases: pd.DataFrame) -> dict[str, float]:
    """Compute one method's rates with Wilson 95 % bounds, summaries of its errors, and its areas of risk.

    Rates and errors are over the cases whose model is that of the vessel that was swept: ``success_tre`` over all,
    ``success_accepted`` over those that the method accepted, ``acceptance`` their share, ``right_accepted`` the share
    of right results that it accepted, ``accepted_wrong`` the share of all that were accepted and are wrong. Of the
    other cases any result is wrong: ``wrong_vessel_accepted`` is the share that was accepted all the same. A method
    that does not judge its results has no rate of acceptance. ``interval_coverage`` is the share of predicted 90 %
    intervals that hold the error, up to symmetry; ``high_over_error`` sets their upper end against it. The areas of
    risk are over all cases.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of one method, as ``score_result`` gives them.

    Returns
    -------
    dict
        Scalars by the name of the metric; errors in mm and deg, run time in s. Metrics that are not defined
        are absent.
    """
    found = {"cases": float(len(cases)), "cases_without_result": float((cases["error"] != "").sum())}
    own, others = own_vessel(cases), cases[~cases["same_vessel"].astype(bool)]
    found |= _own_rates(own, judges(cases))
    if judges(cases):
        found |= _rate("wrong_vessel_accepted", others["verdict"] == ACCEPTED)
    deformed = own["lowest_tre_mm"] > 0
    for name in SUMMARISED + (DEFORMED if deformed.any() else ()):
        if len(own) and own[name].notna().all():
            found |= summary(name, own[name].tolist())
    if len(ratios := own["high_over_error"].dropna()):
        found |= summary("high_over_error", ratios.tolist())
    if cases["runtime_s"].notna().all():
        found |= summary("runtime_s", cases["runtime_s"].tolist())
    for name, sign in DOUBTS.items():
        if cases[name].notna().any():
            curve = risk_coverage(~cases[RIGHT].to_numpy(bool), sign * cases[name].to_numpy(float))
            found[f"risk_area_{name}"] = curve.area
    if judges(cases):
        found["accepted_failures"] = float(
            ((cases["verdict"] == ACCEPTED) & ~cases[RIGHT].astype(bool)).sum()
        )
        found["over_cautious"] = float(len(over_cautious(cases)))
    return found


def own_vessel(cases: pd.DataFrame) -> pd.DataFrame:
    """Select the cases whose model is that of the vessel that was swept: of the others no result is right.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of one or several methods.

    Returns
    -------
    pandas.DataFrame
        The rows among ``cases``.
    """
    return cases[cases["same_vessel"].astype(bool)]


def over_cautious(cases: pd.DataFrame) -> pd.DataFrame:
    """Select results that were right and not accepted, although no second pose explains their case.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of one or several methods.

    Returns
    -------
    pandas.DataFrame
        The rows among ``cases``.
    """
    return cases[doubted(cases) & cases[RIGHT] & (cases["ambiguous_rightly"] == 0)]


def doubted(cases: pd.DataFrame) -> pd.Series:
    """Mark the results that their own method did not accept.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of one or several methods.

    Returns
    -------
    pd.Series
        Truth values by row of ``cases``; False where the method does not judge its results.
    """
    return ~cases["verdict"].isin([ACCEPTED, NOT_JUDGED])


def success_interval(cases: pd.DataFrame) -> Interval:
    """Compute the share of right results with its interval by the bootstrap over anatomies.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of one method; those of other vessels do not count.

    Returns
    -------
    Interval
        The share (0 to 1) and its 95 % interval; the bounds are NaN for a single anatomy.
    """
    own = own_vessel(cases)
    return Bootstrap("mean_of_cases")(own[RIGHT].astype(float), own["anatomy"].tolist())


def each_method(cases: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame]]:
    """Split the cases by method.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of all methods, with a column ``method``.

    Yields
    ------
    tuple[str, pandas.DataFrame]
        Name and rows of each method, in the order they first occur.
    """
    for name in cases["method"].drop_duplicates():
        yield str(name), cases[cases["method"] == name]


def _own_rates(own: pd.DataFrame, judging: bool) -> dict[str, float]:
    right, sure = own[RIGHT].astype(bool), own["verdict"] == ACCEPTED
    accepted, unjudged = own[sure] if judging else own.iloc[:0], own[RIGHT].iloc[:0]
    found: dict[str, float] = {}
    for name, values in (
        ("success_tre", own["success_tre"]),
        (RIGHT, right),
        ("success", own.loc[own["rmse_mm"].notna(), "success"]),
        ("acceptance", sure if judging else unjudged),
        ("success_accepted", accepted[RIGHT]),
        ("right_accepted", sure[right] if judging else unjudged),
        ("accepted_wrong", sure & ~right if judging else unjudged),
        ("interval_coverage", own["covered_by_interval"].dropna()),
        ("interval_coverage_accepted", accepted["covered_by_interval"].dropna()),
        ("ambiguous_rightly", own["ambiguous_rightly"].dropna()),
    ):
        found |= _rate(name, values)
    return found


def _rate(name: str, values: pd.Series) -> dict[str, float]:
    """A rate and its bounds, or nothing where there is nothing to count."""
    if not len(values):
        return {}
    share = wilson_interval(int(values.sum()), len(values))
    return {f"{name}_rate": share.rate, f"{name}_rate_low": share.low, f"{name}_rate_high": share.high}
