"""Intervals for what the studies count, and the summary of what they measure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from experiments.errors import InputError


@dataclass(frozen=True)
class Proportion:
    """A rate with its interval: ``successes`` of ``trials``, ``rate`` between ``low`` and ``high``."""

    successes: int
    trials: int
    rate: float
    low: float
    high: float


def wilson_interval(successes: int, trials: int, level: float = 0.95) -> Proportion:
    """The score interval of a proportion (Wilson, J. Am. Stat. Assoc. 22, 1927), without continuity correction.

    >>> interval = wilson_interval(60, 60)
    >>> round(interval.low, 3), interval.high
    (0.94, 1.0)
    """
    from scipy.stats import binomtest

    if trials < 1:
        raise InputError(f"trials: expected at least 1, received {trials}")
    if not 0 <= successes <= trials:
        raise InputError(f"successes: expected 0 to {trials}, received {successes}")
    if not 0 < level < 1:
        raise InputError(f"level: expected a level between 0 and 1, received {level}")
    interval = binomtest(successes, trials).proportion_ci(level, method="wilson")
    return Proportion(successes, trials, successes / trials, float(interval.low), float(interval.high))


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
