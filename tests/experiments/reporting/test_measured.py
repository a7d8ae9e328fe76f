"""Measured values in words."""

from __future__ import annotations

import math

from experiments.reporting.measured import p_text


def test_a_test_is_told_with_the_least_p_that_its_units_can_give() -> None:
    assert p_text(0.25, 0.0625) == "signed-rank test: p 0.25 (least attainable 0.062)"
    assert p_text(math.nan, math.nan) == "not tested"
