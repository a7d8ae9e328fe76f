"""Calibrations fitted to logits that are wrong in a known way, and their reliability by groups."""

from __future__ import annotations

import numpy as np
import pytest
from known_predictions import disc, known_prediction

from experiments.analysis.consolidation.calibrations import (
    BOUNDARY,
    NONE,
    TEMPERATURE,
    TEMPERATURE_BIAS,
    calibration_rows,
    fit_calibrations,
)
from experiments.analysis.consolidation.predictions import IDENTITY, Prediction
from models.calibration import calibration_statistics


def sampled(factor: float, shift: float, count: int = 6) -> Prediction:
    """Cases whose labels are drawn from ``sigmoid(z)``, with logits ``factor * z + shift``."""
    random = np.random.default_rng(0)
    true = random.normal(0, 1.5, (count, 48, 48))
    masks = random.random(true.shape) < 1 / (1 + np.exp(-true))
    return known_prediction(
        list(factor * true + shift), list(masks), [f"g{place % 3}" for place in range(count)]
    )


def test_a_factor_becomes_the_temperature_and_a_shift_the_bias() -> None:
    fitted = fit_calibrations(sampled(2.0, 1.0), band_px=1.0)
    assert fitted.scalings[NONE] == IDENTITY and not fitted.refusals
    both = fitted.scalings[TEMPERATURE_BIAS]
    assert both.temperature == pytest.approx(2.0, rel=0.06) and both.bias == pytest.approx(-0.5, abs=0.05)
    alone = fit_calibrations(sampled(2.0, 0.0), band_px=1.0).scalings[TEMPERATURE]
    assert alone.temperature == pytest.approx(2.0, rel=0.06) and alone.bias == 0.0


def test_a_calibration_of_the_boundary_looks_at_the_band_alone() -> None:
    random = np.random.default_rng(1)
    mask = disc(48, 24, 24, 12)
    # Sure and right but for the band: normal logits of variance 16 and means of 2 and -2 are 4 times too large.
    logits = np.where(mask, 8.0, -8.0)
    near = disc(48, 24, 24, 14) & ~disc(48, 24, 24, 10)
    logits[near] = random.normal(0, 4, near.sum()) + np.where(mask[near], 2.0, -2.0)
    fitted = fit_calibrations(known_prediction([logits], [mask], ["a"]), band_px=2.0)
    assert fitted.scalings[BOUNDARY].temperature == pytest.approx(4.0, rel=0.25)
    assert fitted.scalings[BOUNDARY].temperature > 1.3 * fitted.scalings[TEMPERATURE_BIAS].temperature


def test_perfect_logits_are_not_calibrated_and_the_reason_is_kept() -> None:
    mask = disc(32, 16, 16, 8)
    fitted = fit_calibrations(known_prediction([np.where(mask, 3.0, -3.0)], [mask], ["a"]), band_px=2.0)
    assert fitted.scalings[TEMPERATURE] == IDENTITY
    assert "separated perfectly" in fitted.refusals[TEMPERATURE]


def test_rows_add_up_to_the_scores_of_all_cases() -> None:
    prediction = sampled(1.5, 0.3)
    rows = calibration_rows(prediction, IDENTITY, band_px=1.0)
    images = [(IDENTITY(logits), mask) for logits, mask, _ in prediction.windows()]
    expected = calibration_statistics(images, band_px=1.0).scores
    for region, ece, ace in (
        ("everywhere", expected.ece, expected.ace),
        ("boundary", expected.ece_boundary, None),
    ):
        bins = [row for row in rows if row["region"] == region and row["group"] != ""]
        gaps: dict[int, float] = {}
        for row in bins:
            gaps[row["bin"]] = gaps.get(row["bin"], 0.0) + row["probability_sum"] - row["vessel_pixels"]
        pixels = sum(row["pixels"] for row in bins)
        assert sum(map(abs, gaps.values())) / pixels == pytest.approx(ece)
        if ace is not None:
            assert sum(row["nll_sum"] for row in bins) / pixels == pytest.approx(expected.nll)
            (total,) = [row for row in rows if row["group"] == "" and row["region"] == region]
            assert total["ace"] == pytest.approx(ace)
