"""Measured values that stand next to published ones: what a study hands to the report, in one form for all studies."""

from __future__ import annotations

import math
from dataclasses import dataclass

SIMULATED = "simulated, not comparable"
OTHER_DATA = "other data, not comparable"


@dataclass(frozen=True)
class Measured:
    """What a study measured of one published value.

    Parameters
    ----------
    name : str
        Name of the published value in the study's list in ``conf/published.yaml``.
    of : str
        What was measured: the model, phantom or method, and on which data.
    value : float
        Measured value in the metric's own unit, a share where % is published; NaN where a sentence was published that
        no single number answers, infinity where a failure left no value.
    low, high : float, optional
        Bounds of its 95 % interval; NaN where there is none.
    n : int, optional
        Number of independent units; 0 if unknown.
    units : str, optional
        What the units are: groups, sweeps, anatomies, repeats.
    said : str, optional
        Test or comparison in words.
    not_comparable : str, optional
        Why the value cannot be held against the published one (``SIMULATED``, ``OTHER_DATA``); empty where it can.
    small : bool, optional
        Whether it comes from a run that only shows that all works (``trainer=smoke``).
    """

    name: str
    of: str
    value: float = math.nan
    low: float = math.nan
    high: float = math.nan
    n: int = 0
    units: str = ""
    said: str = ""
    not_comparable: str = ""
    small: bool = False


def p_text(p: float, least: float, test: str = "signed-rank test") -> str:
    """Write the result of a test with the least p that so few units can give.

    Parameters
    ----------
    p : float
        P value; NaN where nothing was tested.
    least : float
        Least attainable p.
    test : str, optional
        Name of the test.

    Returns
    -------
    str
        The result in words; ``not tested`` where there is none.

    Examples
    --------
    >>> p_text(0.25, 0.0625)
    'signed-rank test: p 0.25 (least attainable 0.062)'
    """
    if math.isnan(p):
        return "not tested"
    return f"{test}: p {p:.2g} (least attainable {least:.2g})"
