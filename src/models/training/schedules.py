"""Factors of the highest learning rate for torch's LambdaLR, as functions of the step alone.

Functions of the step can be entered at any step, which exact resume needs; torch's own cosine schedule accumulates.
"""

from __future__ import annotations

import math
from collections.abc import Callable

SCHEDULES = ("cosine", "one_cycle")
# The default share of a one-cycle training in which the rate rises, and how far it goes down at
# both ends: the customary values, which are also those of torch.
ONE_CYCLE_RISE = 0.3
FIRST_DIVISOR, LAST_DIVISOR = 25.0, 1e4


def factor(schedule: str, step: int, rise: int, total: int) -> float:
    """Compute the factor of the highest learning rate at one step.

    Parameters
    ----------
    schedule : str
        One of ``SCHEDULES``.
    step : int
        Step, counted from 0.
    rise : int
        Number of steps that lead up to 1.
    total : int
        Number of all steps.

    Returns
    -------
    float
        Factor, 0 to 1.
    """
    functions: dict[str, Callable[[int, int, int], float]] = {"cosine": cosine, "one_cycle": one_cycle}
    return functions[schedule](step, rise, total)


def cosine(step: int, rise: int, total: int) -> float:
    """Compute the factor of a linear rise followed by half a cosine down to zero, without restarts.

    Parameters
    ----------
    step : int
        Step, counted from 0.
    rise : int
        Number of steps that lead up to 1.
    total : int
        Number of all steps.

    Returns
    -------
    float
        Factor, 0 to 1.

    References
    ----------
    I. Loshchilov and F. Hutter, ICLR 2017.
    """
    if step < rise:
        return (step + 1) / (rise + 1)
    return 0.5 * (1 + math.cos(math.pi * min(1.0, (step - rise) / max(1, total - rise))))


def one_cycle(step: int, rise: int, total: int) -> float:
    """Compute the factor of half a cosine up from 1/25 followed by half a cosine down to 1/250000.

    Only the learning rate runs in a cycle; the optimiser's momentum stays.

    Parameters
    ----------
    step : int
        Step, counted from 0.
    rise : int
        Number of steps that lead up to 1; the last of them has the peak.
    total : int
        Number of all steps.

    Returns
    -------
    float
        Factor, 0 to 1.

    References
    ----------
    L. N. Smith and N. Topin, SPIE 11006, 2019.
    """
    first, last = 1 / FIRST_DIVISOR, 1 / (FIRST_DIVISOR * LAST_DIVISOR)
    peak = max(0, rise - 1)
    if step < peak:
        return _half_cosine(first, 1.0, step / peak)
    return _half_cosine(1.0, last, min(1.0, (step - peak) / max(1, total - 1 - peak)))


def _half_cosine(start: float, end: float, progress: float) -> float:
    return end + 0.5 * (start - end) * (1 + math.cos(math.pi * progress))
