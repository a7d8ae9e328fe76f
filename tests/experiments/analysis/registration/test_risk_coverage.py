"""Risk against coverage, counted by hand."""

from __future__ import annotations

import numpy as np
import pytest

from experiments.analysis.registration.risk_coverage import risk_coverage
from experiments.errors import InputError


def test_the_surest_results_come_first() -> None:
    wrong = np.array([True, False, False, True])
    curve = risk_coverage(wrong, np.array([3.0, 1.0, 2.0, 4.0]))
    assert curve.coverage.tolist() == [0.25, 0.5, 0.75, 1.0]
    np.testing.assert_allclose(curve.risk, [0, 0, 1 / 3, 1 / 2])
    assert curve.area == pytest.approx((1 / 3 + 1 / 2) / 4)
    assert curve.least_area == pytest.approx(curve.area)


def test_the_opposite_order_is_as_bad_as_can_be() -> None:
    wrong = np.array([True, False, False, True])
    curve = risk_coverage(wrong, -np.array([3.0, 1.0, 2.0, 4.0]))
    np.testing.assert_allclose(curve.risk, [1, 1, 2 / 3, 1 / 2])
    assert curve.least_area < curve.area


def test_doubts_that_are_equal_say_nothing_whatever_the_order_of_the_rows() -> None:
    wrong = np.array([True, False, False, False])
    for turned in (wrong, wrong[::-1]):
        curve = risk_coverage(turned, np.ones(4))
        np.testing.assert_allclose(curve.risk, 0.25)


def test_a_result_without_a_doubt_comes_last() -> None:
    curve = risk_coverage(np.array([True, False]), np.array([np.nan, 100.0]))
    assert curve.risk.tolist() == [0.0, 0.5]


def test_no_results_are_refused() -> None:
    with pytest.raises(
        InputError, match="doubt: expected one for each of at least one result, received 0 for 0"
    ):
        risk_coverage(np.zeros(0, dtype=bool), np.zeros(0))
