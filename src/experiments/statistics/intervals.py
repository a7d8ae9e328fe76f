"""Intervals of proportions, and the summary of measured values."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

from experiments.errors import InputError


@dataclass(frozen=True)
class Proportion:
    """Rate with its interval.

    Parameters
    ----------
    successes : int
        Number of successes.
    trials : int
        Number of trials.
    rate : float
        Share of successes.
    low, high : float
        Bounds of the interval.
    """

    successes: int
    trials: int
    rate: float
    low: float
    high: float


@dataclass(frozen=True)
class Interval:
    """Estimate with its interval.

    The bounds are NaN where an interval is not defined (one unit, or failures on both sides of a difference).

    Parameters
    ----------
    estimate : float
        The estimate.
    low, high : float
        Bounds of the interval.
    level : float
        Confidence level.
    units : int
        Number of independent units.
    """

    estimate: float
    low: float
    high: float
    level: float
    units: int


def wilson_interval(successes: int, trials: int, level: float = 0.95) -> Proportion:
    """Compute the score interval of a proportion, without continuity correction.

    Parameters
    ----------
    successes : int
        Number of successes.
    trials : int
        Number of trials, at least 1.
    level : float, optional
        Confidence level, between 0 and 1.

    Returns
    -------
    Proportion
        Rate and bounds.

    Raises
    ------
    InputError
        If a value is out of range.

    References
    ----------
    E. B. Wilson, J. Am. Stat. Assoc. 22, 1927.

    Examples
    --------
    >>> interval = wilson_interval(60, 60)
    >>> round(interval.low, 3), interval.high
    (0.94, 1.0)
    """
    if trials < 1:
        raise InputError(f"trials: expected at least 1, received {trials}")
    if not 0 <= successes <= trials:
        raise InputError(f"successes: expected 0 to {trials}, received {successes}")
    interval = wilson_of_rate(successes / trials, trials, level)
    return Proportion(successes, trials, interval.estimate, interval.low, interval.high)


def wilson_of_rate(rate: float, trials: int, level: float = 0.95) -> Interval:
    """Compute Wilson's interval of a rate that need not be a whole count of the trials.

    Such a rate is a mean over repetitions (seeds) of the same trials, which add no trials of their own.

    Parameters
    ----------
    rate : float
        Rate from 0 to 1.
    trials : int
        Number of trials, at least 1.
    level : float, optional
        Confidence level, between 0 and 1.

    Returns
    -------
    Interval
        Rate and bounds.

    Raises
    ------
    InputError
        If a value is out of range.
    """
    if trials < 1:
        raise InputError(f"trials: expected at least 1, received {trials}")
    if not 0 <= rate <= 1:
        raise InputError(f"rate: expected 0 to 1, received {rate}")
    check_level(level)
    z = NormalDist().inv_cdf((1 + level) / 2)
    shrunk = 1 + z * z / trials
    middle = (rate + z * z / (2 * trials)) / shrunk
    half = z / shrunk * math.sqrt(rate * (1 - rate) / trials + z * z / (4 * trials * trials))
    # At a rate of 0 or 1 the bound on that side is the rate itself, but for rounding.
    low, high = (0.0 if rate == 0 else middle - half), (1.0 if rate == 1 else middle + half)
    return Interval(rate, low, high, level, trials)


def check_level(level: float) -> None:
    """Check a confidence level.

    Parameters
    ----------
    level : float
        Confidence level.

    Raises
    ------
    InputError
        If it does not lie between 0 and 1.
    """
    if not 0 < level < 1:
        raise InputError(f"level: expected a level between 0 and 1, received {level}")


def summary(name: str, values: Sequence[float]) -> dict[str, float]:
    """Summarise a metric over its cases.

    Parameters
    ----------
    name : str
        Name of the metric.
    values : sequence of float
        One value a case. Infinite values (failures of an error measure) rank worst: the mean is then infinite
        and the standard deviation undefined.

    Returns
    -------
    dict of str to float
        ``<name>_mean``, ``_std`` (of a sample, n - 1; NaN for one case), ``_median``, ``_p95`` and ``_n``. A
        NaN makes all but ``_n`` NaN, so that a failure never leaves a number that looks like a result.

    Raises
    ------
    InputError
        If there is no case.
    """
    import numpy as np

    cases = np.asarray(values, dtype=np.float64)
    if not len(cases):
        raise InputError(f"{name}: expected at least one case to summarise, received none")
    finite = bool(np.isfinite(cases).all())
    # A large finite value keeps the ranks, where the interpolation between two infinities would give NaN.
    ranked = np.where(np.isinf(cases), np.finfo(np.float64).max / 4, cases)
    median, p95 = (
        float(np.inf) if quantile > np.finfo(np.float64).max / 1e3 else float(quantile)
        for quantile in np.percentile(ranked, [50, 95])
    )
    return {
        f"{name}_mean": float(cases.mean()),
        f"{name}_std": float(cases.std(ddof=1)) if finite and len(cases) > 1 else float("nan"),
        f"{name}_median": median,
        f"{name}_p95": p95,
        f"{name}_n": float(len(cases)),
    }
