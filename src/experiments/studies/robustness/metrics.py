"""Rates of the robustness study over any of its trials."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.analysis.registration.pose_scores import judges
from experiments.statistics import Proportion, wilson_interval
from registration.metrics.surface_distance import SUCCESS_RMSE_MM, SUCCESS_TRE_MM

if TYPE_CHECKING:
    import pandas as pd

# What a method must reach in every bin of angles up to its capture range.
CAPTURE_RATE = 0.95
# From fewer trials a bin says nothing of such a rate: all of nine right have a Wilson interval from 70 %.
CAPTURE_TRIALS = 10


def rate_metrics(cases: pd.DataFrame) -> dict[str, float]:
    """Compute success and acceptance rates and the coverage of the intervals, with Wilson bounds.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of the trials of one method.

    Returns
    -------
    dict
        Scalars by name. A rate over no trial is NaN: success among accepted where none was, coverage where no
        error was predicted, and acceptance of methods that do not judge.
    """
    found: dict[str, float] = {}
    taken, predicted = cases[cases["accepted"]], cases[cases["tre_high_mm"].notna()]
    judging = judges(cases)
    for name, each in {
        "success_rate": share(cases["success"]),
        "success_tre_rate": share(cases["success_tre"]),
        "acceptance_rate": share(cases["accepted"]) if judging else None,
        "success_tre_accepted_rate": share(taken["success_tre"]),
        "interval_coverage_accepted_rate": share(inside(predicted[predicted["accepted"]])),
    }.items():
        found |= {
            name: each.rate if each else float("nan"),
            f"{name}_low": each.low if each else float("nan"),
            f"{name}_high": each.high if each else float("nan"),
        }
    return found | {
        "trials": float(len(cases)),
        "trials_accepted": float(len(taken)) if judging else float("nan"),
        "trials_failed": float((cases["error"] != "").sum()),
        "trials_low_rmse_wrong": float(lies(cases).sum()),
    }


def share(values: Any) -> Proportion | None:
    """Compute the share of true values, with Wilson's interval.

    Parameters
    ----------
    values : Any
        Flags.

    Returns
    -------
    Proportion or None
        Share and interval; None for no values.
    """
    flags = np.asarray(values, dtype=bool)
    return wilson_interval(int(flags.sum()), len(flags)) if len(flags) else None


def inside(cases: pd.DataFrame) -> np.ndarray:
    """Find the trials whose true error lies in the interval that the method predicted.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of the trials.

    Returns
    -------
    ndarray of bool, shape (n,)
        True where it does.
    """
    within: np.ndarray = (
        (cases["tre_low_mm"] <= cases["tre_mm"]) & (cases["tre_mm"] <= cases["tre_high_mm"])
    ).to_numpy()
    return within


def lies(cases: pd.DataFrame) -> np.ndarray:
    """Find the trials in which a small residual hides a wrong pose: RMSE calls it a success, TRE does not.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of the trials.

    Returns
    -------
    ndarray of bool, shape (n,)
        True where it does.
    """
    wrong: np.ndarray = (
        (cases["rmse_mm"] <= SUCCESS_RMSE_MM) & ~(cases["tre_mm"] <= SUCCESS_TRE_MM)
    ).to_numpy()
    return wrong


def by_bin(cases: pd.DataFrame) -> pd.DataFrame:
    """Count the successes in each bin of angles.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of the trials.

    Returns
    -------
    pandas.DataFrame
        Columns ``angle_from_deg``, ``angle_to_deg``, ``successes`` and ``trials``, sorted by angle.
    """
    binned = cases.dropna(subset="angle_from_deg")
    found = (
        binned.groupby(["angle_from_deg", "angle_to_deg"])["success_tre"].agg(["sum", "size"]).reset_index()
    )
    return found.rename(columns={"sum": "successes", "size": "trials"})


def capture_range_deg(cases: pd.DataFrame) -> float:
    """Find the largest angle up to which every bin has a success rate of at least 95 %.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of the trials of one method.

    Returns
    -------
    float
        Angle in degrees; 0 if the first bin does not reach the rate, NaN without binned trials or where a bin
        has fewer than 10. A bin without trials ends the range.
    """
    bins = by_bin(cases)
    if not len(bins) or bins["trials"].min() < CAPTURE_TRIALS:
        return float("nan")
    reached_deg = 0.0
    columns = ("angle_from_deg", "angle_to_deg", "successes", "trials")
    for begin_deg, end_deg, successes, trials in bins[list(columns)].to_numpy(dtype=float).tolist():
        if begin_deg > reached_deg or successes < CAPTURE_RATE * trials:
            break
        reached_deg = end_deg
    return reached_deg
