"""Risk against coverage: how many answers are wrong among those that a method is surest of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from experiments.errors import InputError


@dataclass(frozen=True)
class RiskCoverage:
    """The share of wrong answers, ``risk`` (n,), among the surest k of n, whose share is ``coverage`` (n,).

    ``area`` is the mean of the risk over all k: 0 where every answer is right, the error rate where the order says
    nothing. ``least_area`` is that of the best order there could be.
    """

    coverage: np.ndarray
    risk: np.ndarray
    area: float
    least_area: float


def risk_coverage(wrong: np.ndarray, doubt: np.ndarray) -> RiskCoverage:
    """Accept answers in order of their ``doubt``, least first (El-Yaniv and Wiener, J. Mach. Learn. Res. 11, 2010).

    Answers of equal doubt are in no order: each counts as the mean of theirs. A NaN is the greatest doubt. Raises
    InputError for no answers, or as many doubts as not answers.

    >>> risk_coverage(np.array([True, False]), np.array([2.0, 1.0])).risk.tolist()
    [0.0, 0.5]
    """
    if not len(wrong) or len(wrong) != len(doubt):
        raise InputError(
            f"doubt: expected one for each of at least one answer, received {len(doubt)} for {len(wrong)}"
        )
    values, group = np.unique(np.where(np.isnan(doubt), np.inf, doubt), return_inverse=True)
    wrongs, sizes = np.bincount(group, wrong.astype(float), len(values)), np.bincount(group)
    each = np.repeat(wrongs / sizes, sizes)
    count = np.arange(1, len(wrong) + 1)
    risk = np.cumsum(each) / count
    best = np.cumsum(np.sort(wrong.astype(float))) / count
    return RiskCoverage(count / len(wrong), risk, float(risk.mean()), float(best.mean()))
