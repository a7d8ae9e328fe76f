"""Rates over trials that were counted by hand."""

from __future__ import annotations

import math

import pandas as pd
import pytest
from robustness_rows import FAR, SILENT, binned, row

from experiments.analysis.registration.pose_scores import judges
from experiments.studies.robustness.metrics import (
    by_bin,
    capture_range_deg,
    inside,
    lies,
    rate_metrics,
)


def test_rates_are_counts_with_wilson_bounds() -> None:
    cases = pd.DataFrame(
        [row() for _ in range(6)]
        + [row(tre_mm=0.7), row(tre_mm=FAR, rmse_mm=0.9)]
        + [
            row(tre_mm=FAR, accepted=False),
            row(tre_mm=math.inf, rmse_mm=math.inf, accepted=False, error="lost"),
        ]
    )
    found = rate_metrics(cases)
    assert found["success_tre_rate"] == 0.7
    assert found["success_rate"] == 0.9
    assert found["acceptance_rate"] == 0.8
    assert found["success_tre_accepted_rate"] == pytest.approx(7 / 8)
    # Of eight accepted, six have their error between 0.1 and 0.6 mm.
    assert found["interval_coverage_accepted_rate"] == pytest.approx(6 / 8)
    assert (found["trials"], found["trials_accepted"], found["trials_failed"]) == (10, 8, 1)
    assert found["trials_low_rmse_wrong"] == 2
    assert found["success_tre_rate_low"] == pytest.approx(0.397, abs=1e-3)
    assert found["success_tre_rate_high"] == pytest.approx(0.892, abs=1e-3)


def test_a_rate_of_nothing_is_no_number() -> None:
    found = rate_metrics(pd.DataFrame([row(accepted=False, tre_low_mm=math.nan, tre_high_mm=math.nan)]))
    assert math.isnan(found["success_tre_accepted_rate"]) and math.isnan(
        found["interval_coverage_accepted_rate"]
    )
    assert math.isnan(found["interval_coverage_accepted_rate_low"])


def test_intervals_hold_their_own_ends() -> None:
    cases = pd.DataFrame([row(tre_mm=value) for value in (0.09, 0.1, 0.3, 0.6, 0.61)])
    assert inside(cases).tolist() == [False, True, True, True, False]


def test_a_low_residual_of_a_wrong_pose_lies() -> None:
    cases = pd.DataFrame(
        [row(rmse_mm=rmse, tre_mm=tre) for rmse, tre in ((1.0, 2.0), (1.0, 2.1), (1.1, 2.1), (1.1, 1.0))]
    )
    assert lies(cases).tolist() == [False, True, False, False]


def test_the_capture_range_ends_before_the_first_bin_that_falls_short() -> None:
    def ranged(right: list[int], trials: int = 20) -> float:
        return capture_range_deg(pd.DataFrame(binned("a", right, trials)))

    assert ranged([20, 19, 20]) == 45
    assert ranged([20, 18, 20]) == 15
    assert ranged([18, 20, 20]) == 0
    gap = pd.DataFrame(
        [
            *binned("a", [10], 10),
            *(each | {"angle_from_deg": 30.0, "angle_to_deg": 45.0} for each in binned("a", [10], 10)),
        ]
    )
    assert capture_range_deg(gap) == 15
    assert ranged([10, 10], 10) == 30
    # Nine trials a bin, all of them right, are too few for a rate of 95 %.
    assert math.isnan(ranged([9, 9], 9))
    assert math.isnan(ranged([1, 1], 1))
    flips = pd.DataFrame([row(rotation="flip", angle_from_deg=math.nan, angle_to_deg=math.nan)])
    assert math.isnan(capture_range_deg(flips))


def test_bins_are_sorted_and_counted() -> None:
    bins = by_bin(pd.DataFrame(binned("a", [1, 3], 4)[::-1]))
    assert bins[["angle_from_deg", "successes", "trials"]].to_numpy().tolist() == [[0, 1, 4], [15, 3, 4]]


def test_a_method_that_does_not_judge_has_no_acceptance() -> None:
    rates = rate_metrics(pd.DataFrame([row(**SILENT), row(tre_mm=40.0, **SILENT)]))
    assert rates["success_tre_rate"] == 0.5
    for name in (
        "acceptance_rate",
        "success_tre_accepted_rate",
        "interval_coverage_accepted_rate",
        "trials_accepted",
    ):
        assert math.isnan(rates[name]), name
    # One that raised in some trials still does not judge the others; one that only ever raised says nothing.
    lost = row(tre_mm=math.inf, error="RuntimeError: lost", accepted=False)
    assert not judges(pd.DataFrame([row(**SILENT), lost]))
    assert not judges(pd.DataFrame([lost]))
    assert judges(pd.DataFrame([row(accepted=False), lost]))
    assert rate_metrics(pd.DataFrame([row(), lost]))["acceptance_rate"] == 0.5
