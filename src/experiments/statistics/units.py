"""One value for each independent unit, from the cases of a study."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal

from experiments.errors import InputError

if TYPE_CHECKING:
    import pandas as pd


def by_unit(
    cases: pd.DataFrame,
    metric: str,
    unit: str = "group",
    *,
    failed: float | None = None,
    statistic: Literal["mean", "median"] = "mean",
) -> pd.Series[float]:
    """Average a metric over the cases of each unit.

    Frames of one sweep, or trials on one anatomy, resemble each other: counted one by one they would make any
    difference significant (the unit of analysis: Altman and Bland).

    Parameters
    ----------
    cases : pandas.DataFrame
        One row a case.
    metric : str
        Column of the metric.
    unit : str, optional
        Column of the unit.
    failed : float or None, optional
        Value that a NaN counts as: infinity in an error, minus infinity or 0 in a score. None says that NaN
        is no failure but a case for which the metric is not defined; such cases, and units of nothing else,
        are left out.
    statistic : {"mean", "median"}, optional
        Statistic over the cases of a unit. An infinite case makes its unit's mean infinite, so that a unit
        with one failure ranks worst; the median is infinite only if more than half of the cases failed (with
        an even number, half).

    Returns
    -------
    pandas.Series of float
        One value a unit, indexed by unit in sorted order.

    Raises
    ------
    InputError
        If a column is missing, a case has no unit, the statistic is unknown, or a unit has infinite values of
        both signs.

    References
    ----------
    D. G. Altman and J. M. Bland, BMJ 314, 1997.
    """
    for column in (metric, unit):
        if column not in cases:
            raise InputError(f"cases: expected a column {column!r}, received {', '.join(map(str, cases))}")
    if cases[unit].isna().any():
        raise InputError(f"{unit}: expected a name in every case, {cases[unit].isna().sum()} have none")
    if statistic not in ("mean", "median"):
        raise InputError(f"statistic: expected mean or median, received {statistic!r}")
    scores = cases[[unit, metric]].astype({metric: float})
    scores = scores.dropna(subset=metric) if failed is None else scores.fillna({metric: failed})
    units = scores.groupby(unit, sort=True)[metric]
    both = (units.min() == -math.inf) & (units.max() == math.inf)
    if both.any():
        raise InputError(
            f"{metric}: expected failures of one sign, {unit} {both.idxmax()} has infinities of both signs"
        )
    return units.mean() if statistic == "mean" else units.median()
