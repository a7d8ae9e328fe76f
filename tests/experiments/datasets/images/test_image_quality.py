"""Five measures with known answers, and the rule that finds what was planted."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from experiments.datasets.images.image_quality import (
    MEASURES,
    MIN_DEVIATION,
    QualityOutliers,
    measure,
    robust_scores,
)
from experiments.errors import InputError


def picture(seed: int, sigma: float = 1.5, level: float = 90.0, deviation: float = 20.0) -> np.ndarray:
    """Grain of Gaussian correlation with that mean and deviation."""
    grain = gaussian_filter(np.random.default_rng(seed).standard_normal((96, 128)), sigma, mode="wrap")
    return np.clip(level + deviation * grain / grain.std(), 0, 255).astype(np.uint8)


def test_brightness_and_contrast_are_logarithms_of_mean_and_deviation() -> None:
    halves = np.repeat(np.array([[40, 60]], np.uint8), 16, axis=0).repeat(8, axis=1)
    found = measure(halves)
    assert found.brightness == pytest.approx(np.log(51)) and found.contrast == pytest.approx(np.log(11))


def test_saturation_is_the_share_of_the_brightest_pixels() -> None:
    image = np.full((10, 10), 249, np.uint8)
    image[0, :7] = (250, 251, 252, 253, 254, 255, 255)
    assert measure(image).saturation == pytest.approx(0.07)


def test_grain_grows_with_its_correlation() -> None:
    # A Gaussian blur of deviation s gives an autocorrelation exp(-d^2 / 4 s^2): one half at d = 2 s sqrt(ln 2).
    found = {sigma: float(np.exp(measure(picture(0, sigma)).speckle_px)) for sigma in (1.0, 1.5, 2.0, 3.0)}
    for sigma in (1.0, 1.5):
        assert found[sigma] == pytest.approx(2 * sigma * np.sqrt(np.log(2)), rel=0.12)
    # Taking the local mean off makes coarse grain look finer than it is, but never finer than fine grain.
    assert list(found.values()) == sorted(found.values())


def test_a_blurred_image_is_less_sharp_at_the_same_contrast() -> None:
    sharp, soft = measure(picture(0, 1.0)), measure(picture(0, 2.0))
    assert sharp.contrast == pytest.approx(soft.contrast, abs=0.02)
    assert sharp.sharpness > soft.sharpness + 0.5


def test_a_uniform_image_has_finite_measures() -> None:
    found = measure(np.zeros((20, 20), np.uint8))
    assert all(np.isfinite(getattr(found, name)) for name in MEASURES)


def test_scores_are_deviations_from_the_median_in_units_of_the_scaled_mad() -> None:
    column = np.array([1.0, 2.0, 3.0, 4.0, 100.0])
    scores = robust_scores(np.column_stack([column] * len(MEASURES)))
    np.testing.assert_allclose(scores[:, 0], (column - 3.0) / (1.4826 * 1.0))


def test_equal_images_are_no_outliers_and_small_differences_among_them_neither() -> None:
    values = np.zeros((9, len(MEASURES)))
    values[3, 0] = 2 * MIN_DEVIATION.brightness
    assert robust_scores(values)[3, 0] == pytest.approx(2.0)
    assert QualityOutliers()([picture(0)] * 6) == () and QualityOutliers()([]) == ()


def test_finds_planted_outliers_and_says_by_which_measure() -> None:
    images = [picture(seed, level=90 + 5 * np.sin(seed)) for seed in range(40)]
    images[7] = picture(7, level=20)  # dark
    images[19] = picture(19, sigma=3.5)  # coarse and blurred
    images[31] = picture(31).copy()
    images[31][:20] = 255  # burnt out
    found = QualityOutliers(3.5)(images)
    assert {one.index for one in found} == {7, 19, 31}
    reasons = {index: {one.measure for one in found if one.index == index} for index in (7, 19, 31)}
    assert (
        "brightness" in reasons[7]
        and {"sharpness", "speckle_px"} <= reasons[19]
        and "saturation" in reasons[31]
    )
    dark = next(one for one in found if one.index == 7 and one.measure == "brightness")
    assert dark.score < -3.5 and dark.value == pytest.approx(measure(images[7]).brightness)
    assert QualityOutliers(3.5)(images) == found


def test_a_wider_limit_finds_less() -> None:
    images = [picture(seed) for seed in range(20)] + [picture(20, level=75), picture(21, level=15)]
    assert {one.index for one in QualityOutliers(12.0)(images)} == {21}
    for limit in (0, -1.0, float("nan")):
        with pytest.raises(InputError, match="quality_limit: expected a number above 0"):
            QualityOutliers(limit)
