"""The measures against known answers, and simulated frames against real ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from experiments.reporting.phantom_realism import dark_dsc, gcnr, grain_px, vessel_gcnr
from registration.errors import InputError
from registration.phantom.acoustics import Scanner
from registration.phantom.settings import SUBSETS, PhantomSettings
from registration.phantom.simulator import SweepSimulator

Case = tuple[np.ndarray, np.ndarray]


def test_gcnr_of_equal_separate_and_half_overlapping_sets() -> None:
    low, high = np.full(100, 20, dtype=np.uint8), np.full(100, 200, dtype=np.uint8)
    assert gcnr(low, low) == pytest.approx(0.0)
    assert gcnr(low, high) == pytest.approx(1.0)
    half = np.concatenate([low[:50], high[:50]])
    assert gcnr(low, half) == pytest.approx(0.5)
    with pytest.raises(InputError, match="gcnr"):
        gcnr(low, np.empty(0, dtype=np.uint8))


def test_vessel_gcnr_counts_each_vessel_and_skips_specks() -> None:
    rows, columns = np.mgrid[:200, :300]
    mask = (np.hypot(rows - 100, columns - 80) < 30) | (np.hypot(rows - 100, columns - 220) < 25)
    mask[5:8, 5:8] = True
    image = np.where(mask, 10, 180).astype(np.uint8)
    assert vessel_gcnr(image, mask) == pytest.approx([1.0, 1.0])


def test_grain_of_smoothed_noise_is_its_width() -> None:
    white = np.random.default_rng(0).standard_normal((480, 480))
    smooth = gaussian_filter(white, (1.5, 3.0))
    image = np.clip(100 + 25 * smooth / smooth.std(), 0, 255).astype(np.uint8)
    # Autocorrelation of Gaussian-filtered noise: deviation times sqrt(2), full width at half maximum 2.355 of it.
    expected = 2.355 * np.sqrt(2) * np.array([1.5, 3.0])
    np.testing.assert_allclose(grain_px(image, np.ones(image.shape, dtype=bool)), expected, rtol=0.12)
    assert np.isnan(grain_px(image, np.zeros(image.shape, dtype=bool))).all()


def test_otsu_finds_a_dark_vessel_alone_and_not_among_other_dark() -> None:
    image = np.full((60, 60), 200, dtype=np.uint8)
    mask = np.zeros((60, 60), dtype=bool)
    mask[20:40, 20:40] = True
    image[mask] = 10
    assert dark_dsc(image, mask) == 1.0
    image[:, 45:] = 10
    assert dark_dsc(image, mask) == pytest.approx(2 * 400 / (400 + 400 + 900))


@pytest.fixture(scope="module")
def simulated() -> list[Case]:
    cases = []
    for subset in SUBSETS:
        maker = SweepSimulator(
            PhantomSettings(subset=subset, scanner=Scanner(height_px=512, width_px=512)), 0
        )
        cases += [maker.frame(frame, maker.view(frame))[:2] for frame in (12, 48)]
    return cases


def test_brightness_alone_does_not_find_the_vessel(simulated: list[Case]) -> None:
    assert max(dark_dsc(*case) for case in simulated) < 0.75


def test_contrast_and_grain_lie_within_the_spread_of_real_frames(
    simulated: list[Case], real_data: Path
) -> None:
    from PIL import Image

    real: list[Case] = []
    for path in sorted((real_data / "usgra" / "images").glob("*.png"))[::5]:
        labels = np.asarray(Image.open(real_data / "usgra" / "masks" / path.name))
        labels = labels[..., 0] if labels.ndim == 3 else labels
        real.append((np.asarray(Image.open(path).convert("L")), labels == 2))
    low, high = np.percentile([value for case in real for value in vessel_gcnr(*case)], [5, 95])
    contrast = np.array([value for case in simulated for value in vessel_gcnr(*case)])
    assert low < np.median(contrast) < high
    assert ((contrast > low) & (contrast < high)).mean() >= 0.7
    seen = [
        (picture, gaussian_filter(picture.astype(float), 3) > 4)
        for picture, _ in real
        if picture.shape[0] == 512
    ]
    low_px, high_px = np.nanpercentile([grain_px(*one) for one in seen], [5, 95], axis=0)
    grain = np.nanmedian([grain_px(picture, picture >= 0) for picture, _ in simulated], axis=0)
    assert (low_px < grain).all()
    assert (grain < high_px).all()
