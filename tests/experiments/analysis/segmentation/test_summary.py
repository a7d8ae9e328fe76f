"""Metrics of known cases, and their bounds by the statistics' own functions."""

from __future__ import annotations

import numpy as np
import pytest
from scored_cases import DIAGONAL_PX, scored_cases

from experiments.analysis.segmentation.summary import pooled_metrics
from experiments.statistics import Bootstrap, wilson_interval


def test_bounds_are_over_groups_and_rates_have_wilsons() -> None:
    cases = scored_cases({"unet": 0.0})
    missed = cases["case_id"] == "x-2-1"
    cases.loc[missed, ["dsc", "hd95_px", "hd95_unpenalised_px", "missed"]] = [0.0, DIAGONAL_PX, np.nan, 1.0]
    metrics = pooled_metrics(cases)
    shown = cases.dropna(subset="dsc")
    dsc = Bootstrap("mean_of_cases")(shown["dsc"], shown["group"].tolist())
    assert metrics["dsc_mean"] == pytest.approx(shown["dsc"].mean()) == pytest.approx(dsc.estimate)
    assert (metrics["dsc_ci_low"], metrics["dsc_ci_high"]) == (dsc.low, dsc.high)
    assert metrics["hd95_px_ci_low"] < metrics["hd95_px_mean"] < metrics["hd95_px_ci_high"]
    share = wilson_interval(1, 18)
    assert metrics["missed_rate"] == pytest.approx(1 / 18)
    assert (metrics["missed_rate_low"], metrics["missed_rate_high"]) == pytest.approx((share.low, share.high))
    assert metrics["false_alarm_rate_high"] == pytest.approx(wilson_interval(0, 6).high)
    # Only the 17 cases in which both masks show the vessel.
    assert metrics["hd95_unpenalised_px_n"] == 17
    assert metrics["hd95_unpenalised_px_mean"] < metrics["hd95_px_mean"]
    assert not [name for name in metrics if "unpenalised" in name and "ci" in name]


def test_one_group_has_no_interval_and_no_number_in_its_place() -> None:
    metrics = pooled_metrics(scored_cases({"unet": 0.0}, groups=1))
    assert not [name for name in metrics if "_ci_" in name]
    assert metrics["dsc_n"] == 3


def test_cases_without_any_vessel_have_only_false_alarms() -> None:
    cases = scored_cases({"unet": 0.0})
    metrics = pooled_metrics(cases[cases["dsc"].isna()])
    assert metrics["false_alarm_rate"] == 0.0 and metrics["dsc_n"] == 0
    assert "dsc_mean" not in metrics and "dsc_ci_low" not in metrics


def test_seeds_are_repetitions_not_cases() -> None:
    once = pooled_metrics(scored_cases({"unet": 0.0}))
    cases = scored_cases({"unet": 0.0}, seeds=(0, 1, 2))
    cases.loc[cases["seed"] == 2, "dsc"] += 0.03
    thrice = pooled_metrics(cases)
    assert thrice["dsc_n"] == once["dsc_n"] == 18
    assert thrice["dsc_mean"] == pytest.approx(once["dsc_mean"] + 0.01)
    assert thrice["dsc_ci_high"] - thrice["dsc_ci_low"] == pytest.approx(
        once["dsc_ci_high"] - once["dsc_ci_low"]
    )
    assert thrice["dsc_seed_std"] == pytest.approx(np.std([0, 0, 0.03], ddof=1))
    assert "dsc_seed_std" not in once


def test_several_models_are_kept_apart() -> None:
    metrics = pooled_metrics(scored_cases({"unet": 0.0, "other": 0.1}, simulated=True))
    assert metrics["other/x/dsc_mean"] == pytest.approx(metrics["unet/x/dsc_mean"] + 0.1)
    assert {"unet/x/dsc_ci_low", "other/x/missed_rate_high"} <= set(metrics)
