"""Intervals for what the studies count, and the summary of what they measure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

from experiments.errors import InputError


@dataclass(frozen=True)
class Proportion:
    """A rate with its interval: ``successes`` of ``trials``, ``rate`` between ``low`` and ``high``."""

    successes: int
    trials: int
    rate: float
    low: float
    high: float


@dataclass(frozen=True)
class Interval:
    """An ``estimate`` between ``low`` and ``high`` at a confidence ``level``, from that many independent ``units``.

    The bounds are NaN where an interval is not defined (one unit, or failures on both sides of a difference).
    """

    estimate: float
    low: float
    high: float
    level: float
    units: int


def wilson_interval(successes: int, trials: int, level: float = 0.95) -> Proportion:
    """The score interval of a proportion (Wilson, J. Am. Stat. Assoc. 22, 1927), without continuity correction.

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
    """Wilson's interval of a rate that need not be a whole count of ``trials``.

    Such a rate is a mean over repetitions (seeds) of the same trials, which add no trials of their own. Raises
    InputError for a rate outside 0 to 1, no trials, or a level that is none.
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
    """Raise InputError unless ``level`` is a confidence level."""
    if not 0 < level < 1:
        raise InputError(f"level: expected a level between 0 and 1, received {level}")


def summary(name: str, values: Sequence[float]) -> dict[str, float]:
    """The five numbers of a metric over its cases: ``<name>_mean``, ``_std``, ``_median``, ``_p95`` and ``_n``.

    Infinite values (failures of an error measure) rank worst: the mean is then infinite and the spread undefined. A
    NaN makes all but ``_n`` NaN: what failed never leaves a number that looks like a result. ``_std`` is that of a
    sample (n - 1), NaN for one case.
    """
    import numpy as np

    cases = np.asarray(values, dtype=np.float64)
    if not len(cases):
        raise InputError(f"{name}: expected at least one case to summarise, received none")
    finite = bool(np.isfinite(cases).all())
    # A large stand-in keeps the ranks, where the interpolation between two infinities would give NaN.
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
