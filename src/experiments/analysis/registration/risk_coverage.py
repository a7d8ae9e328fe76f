"""Risk against coverage: how many results are wrong among those that a method is surest of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from experiments.errors import InputError


@dataclass(frozen=True)
class RiskCoverage:
    """Share of wrong results among the k of n that a method is surest of, for every k.

    Parameters
    ----------
    coverage : ndarray, shape (n,)
        Share k / n of results that are accepted.
    risk : ndarray, shape (n,)
        Share of wrong ones among these.
    area : float
        Mean of the risk over all k: 0 if every result is right, the error rate if the order carries no
        information.
    least_area : float
        The same for the best possible order.
    """

    coverage: np.ndarray
    risk: np.ndarray
    area: float
    least_area: float


def risk_coverage(wrong: np.ndarray, doubt: np.ndarray) -> RiskCoverage:
    """Accept results in order of their doubt, least first, and compute the risk at each coverage.

    Results of equal doubt have no order: each counts as the mean of theirs.

    Parameters
    ----------
    wrong : ndarray of bool, shape (n,)
        Whether each result is wrong.
    doubt : ndarray, shape (n,)
        Doubt in each result, in any unit; NaN counts as the greatest.

    Returns
    -------
    RiskCoverage
        The curve and the area under it.

    Raises
    ------
    InputError
        If there is no result, or not one doubt for each.

    References
    ----------
    R. El-Yaniv and Y. Wiener, J. Mach. Learn. Res. 11, 2010.

    Examples
    --------
    >>> risk_coverage(np.array([True, False]), np.array([2.0, 1.0])).risk.tolist()
    [0.0, 0.5]
    """
    if not len(wrong) or len(wrong) != len(doubt):
        raise InputError(
            f"doubt: expected one for each of at least one result, received {len(doubt)} for {len(wrong)}"
        )
    values, group = np.unique(np.where(np.isnan(doubt), np.inf, doubt), return_inverse=True)
    wrongs, sizes = np.bincount(group, wrong.astype(float), len(values)), np.bincount(group)
    each = np.repeat(wrongs / sizes, sizes)
    count = np.arange(1, len(wrong) + 1)
    risk = np.cumsum(each) / count
    best = np.cumsum(np.sort(wrong.astype(float))) / count
    return RiskCoverage(count / len(wrong), risk, float(risk.mean()), float(best.mean()))
