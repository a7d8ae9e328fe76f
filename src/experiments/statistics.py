"""Intervals for what the studies count."""

from __future__ import annotations

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
