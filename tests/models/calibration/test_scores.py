import math

import numpy as np
import pytest
from sklearn.metrics import brier_score_loss, log_loss

from models.calibration import (
    CalibrationStatistics,
    PixelStatistics,
    TemperatureScaling,
    boundary_band,
    calibration_statistics,
    fit_temperature,
)
from models.errors import InputError


def disc(size: int, radius: float) -> np.ndarray:
    rows, columns = np.indices((size, size)) - (size - 1) / 2
    return np.asarray(np.hypot(rows, columns) <= radius)


def test_scores_by_hand() -> None:
    found = PixelStatistics.of(np.array([0.8, 0.8, 0.4, 0.0]), np.array([1, 0, 1, 0]), n_bins=2)
    assert found.nll == pytest.approx(-(math.log(0.8) + math.log(0.2) + math.log(0.4)) / 4)
    assert found.brier == pytest.approx((0.04 + 0.64 + 0.36 + 0) / 4)
    # Below a half: mean 0.2 and half vessel; above: 0.8 and half vessel.
    assert found.ece == pytest.approx(0.5 * 0.3 + 0.5 * 0.3) and found.pixels == 4


def test_nll_and_brier_equal_scikit_learn() -> None:
    generator = np.random.default_rng(0)
    probability = generator.random(4000).astype(np.float32)
    reference = generator.random(4000) < probability
    found = PixelStatistics.of(probability, reference)
    assert found.nll == pytest.approx(log_loss(reference, probability.astype(float)), rel=1e-6)
    assert found.brier == pytest.approx(brier_score_loss(reference, probability), rel=1e-6)


def test_what_was_thought_impossible_has_a_large_but_finite_likelihood() -> None:
    assert PixelStatistics.of(np.array([0.0]), np.array([1])).nll == pytest.approx(24 * math.log(2))
    assert PixelStatistics.of(np.array([1.0]), np.array([0])).nll == pytest.approx(24 * math.log(2))


def test_a_band_by_hand() -> None:
    reference = np.zeros((5, 7), bool)
    reference[1:4, 2:5] = True
    one = boundary_band(reference, 1.0)
    # On either side the pixels that share an edge with the other class.
    expected = [
        "..###..",
        ".#####.",
        ".##.##.",
        ".#####.",
        "..###..",
    ]
    assert ["".join(".#"[int(pixel)] for pixel in row) for row in one] == expected
    # The corners of the ring are a diagonal away, the centre two pixels.
    wider = boundary_band(reference, 1.5)
    assert wider[0, 1] and not wider[2, 3] and boundary_band(reference, 2.0)[2, 3]


def test_a_band_equals_the_distances_to_the_other_class() -> None:
    generator = np.random.default_rng(0)
    for _ in range(5):
        reference = generator.random((30, 40)) > 0.997
        reference[3:9, int(generator.integers(0, 30)) :] = True
        vessel, background = np.argwhere(reference), np.argwhere(~reference)
        distance = np.empty(reference.shape)
        for own, other in ((vessel, background), (background, vessel)):
            gaps = np.hypot(*(np.subtract.outer(own[:, axis], other[:, axis]) for axis in (0, 1)))
            distance[tuple(own.T)] = gaps.min(axis=1)
        for width in (1, 2.5, 6):
            np.testing.assert_array_equal(boundary_band(reference, width), distance <= width)


def test_one_class_has_no_boundary_and_the_images_border_is_none() -> None:
    assert not boundary_band(np.zeros((4, 4), bool), 3).any()
    assert not boundary_band(np.ones((4, 4), bool), 3).any()
    half = np.zeros((4, 8), bool)
    half[:, :4] = True
    assert boundary_band(half, 1).any(axis=0).tolist() == [False] * 3 + [True] * 2 + [False] * 3


def test_errors_far_from_the_boundary_are_not_in_its_band() -> None:
    reference = disc(64, 12)
    probability = np.where(reference, 0.9, 0.1)
    far = np.hypot(*(np.indices((64, 64)) - 31.5)) > 25
    spoiled = np.where(far, 0.6, probability)
    clean = CalibrationStatistics.of(probability, reference, band_px=3).scores
    wrong = CalibrationStatistics.of(spoiled, reference, band_px=3).scores
    assert wrong.ece_boundary == clean.ece_boundary == pytest.approx(0.1)
    assert wrong.ece > clean.ece + 0.1 and clean.pixels == 64 * 64
    assert clean.pixels_boundary == boundary_band(reference, 3).sum()


def test_a_stream_of_images_gives_what_all_pixels_give() -> None:
    generator = np.random.default_rng(0)
    images = []
    for size in (20, 31, 16):
        probability = generator.random((size, size)).astype(np.float32)
        images.append((probability, probability > 0.5 + 0.3 * (generator.random((size, size)) - 0.5)))
    found = calibration_statistics(iter(images), band_px=2)
    whole = PixelStatistics.of(*(np.concatenate([each[i].ravel() for each in images]) for i in (0, 1)))
    for name in ("nll", "brier", "ece", "ace"):
        assert getattr(found.scores, name) == pytest.approx(getattr(whole, name), rel=1e-9)


def test_an_image_without_a_vessel_has_no_score_at_a_boundary() -> None:
    found = CalibrationStatistics.of(np.full((8, 8), 0.1), np.zeros((8, 8), int), band_px=2)
    assert math.isnan(found.scores.ece_boundary) and found.scores.pixels_boundary == 0
    assert found.scores.ece == pytest.approx(0.1)


def test_calibration_lowers_the_error_at_the_boundary_of_blurred_discs() -> None:
    generator = np.random.default_rng(0)

    def image() -> tuple[np.ndarray, np.ndarray]:
        distance = np.hypot(*(np.indices((64, 64)) - 31.5)) - generator.uniform(8, 20)
        truth = 1 / (1 + np.exp(distance / 2))
        # Three times too sure.
        return (-3 * distance / 2).astype(np.float32), generator.random((64, 64)) < truth

    fitted = fit_temperature(lambda data=[image() for _ in range(20)]: data).scaling
    assert fitted.temperature == pytest.approx(3, rel=0.05)
    held_out = [image() for _ in range(20)]
    before, after = (
        calibration_statistics(((scaling(logits), mask) for logits, mask in held_out), band_px=4).scores
        for scaling in (TemperatureScaling(), fitted)
    )
    assert after.ece_boundary < 0.5 * before.ece_boundary
    assert after.nll < before.nll and after.brier < before.brier and after.ace < before.ace


def test_refuses_no_images_and_no_width() -> None:
    with pytest.raises(InputError, match="images: expected probabilities and references, received none"):
        calibration_statistics([], band_px=2)
    with pytest.raises(InputError, match="band_px: expected a number of pixels from 1"):
        boundary_band(np.ones((2, 2), bool), 0.5)
