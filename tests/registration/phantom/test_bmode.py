"""Statistics of the pictures: speckle by its theory, lumen and wall by what they must look like."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from registration import frames
from registration.phantom.anatomy import Anatomy, from_lines
from registration.phantom.bmode import BMode
from registration.phantom.scan import PROBE_T_IMAGE
from registration.phantom.settings import Scanner, Tissue
from registration.phantom.shapes import spline_line
from registration.phantom.tissue import TissueModel
from scipy import stats

PLAIN = Tissue(texture_db=0.0, fascia_count=0, attenuation_db_cm_mhz=0.5, compensation_db_cm_mhz=0.5)
QUIET = Scanner(noise_db=-120.0, clutter_db=-120.0)


@pytest.fixture(scope="module")
def tube() -> Anatomy:
    """A straight tube 8 mm across, 20 mm below the skin, along z."""
    line = spline_line(np.array([[0.0, 0, -40], [0, 0, 40]]), np.full(2, 4.0))
    return from_lines("tube", (line,), -20.0)


def upright(x_mm: float = 0.0, z_mm: float = 0.0, turn_deg: float = 0.0) -> np.ndarray:
    """tissue_T_image of a probe on the skin that looks to the back, turned about the depth axis."""
    from scipy.spatial.transform import Rotation

    probe = Rotation.from_matrix([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    ct_T_probe = frames.from_rotation(
        probe * Rotation.from_euler("z", turn_deg, degrees=True), np.array([x_mm, -20.0, z_mm])
    )
    return frames.compose(ct_T_probe, PROBE_T_IMAGE)


def homogeneous(imager: BMode, envelope: np.ndarray) -> np.ndarray:
    """Samples of tissue well away from vessel and skin."""
    depth_mm = imager.beams.sample_depth_mm
    chosen = envelope[(depth_mm > 8) & (depth_mm < 32)]
    return np.concatenate([chosen[:, 15:60], chosen[:, -60:-15]], axis=1)


@pytest.mark.parametrize("turn_deg", [0.0, 90.0, 33.0])
def test_speckle_is_fully_developed(tube: Anatomy, turn_deg: float) -> None:
    imager = BMode(QUIET, TissueModel(tube, PLAIN, seed=3))
    samples = np.concatenate(
        [
            homogeneous(imager, np.abs(imager.signal(upright(x_mm, z_mm, turn_deg))[0])).ravel()
            for x_mm, z_mm in ((45, 0), (-45, 9), (50, -9))
        ]
    )
    assert samples.mean() / samples.std() == pytest.approx(1.91, rel=0.05)
    # Average tissue is the reference of all levels.
    assert np.mean(samples**2) == pytest.approx(1.0, rel=0.15)
    # Every 40th sample is independent enough for a test of fit against the Rayleigh law.
    scale = np.sqrt(np.mean(samples**2) / 2)
    assert stats.kstest(samples[::97] / scale, "rayleigh").pvalue > 0.01


def test_speckle_belongs_to_the_tissue_and_decorrelates_with_distance(tube: Anatomy) -> None:
    imager = BMode(QUIET, TissueModel(tube, PLAIN, seed=3))
    start = homogeneous(imager, np.abs(imager.signal(upright(40.0, 0.0))[0]))
    correlations = []
    for step_mm in (0.0, 0.3, 1.0, 4.0):
        moved = homogeneous(imager, np.abs(imager.signal(upright(40.0, step_mm))[0]))
        correlations.append(np.corrcoef(start.ravel(), moved.ravel())[0, 1])
    assert correlations[0] == pytest.approx(1.0)
    assert correlations[0] > correlations[1] > correlations[2] > correlations[3]
    assert correlations[1] > 0.8
    assert abs(correlations[3]) < 0.1
    # Sideways by whole beams, the same speckle appears shifted.
    beams = 10
    shifted = np.abs(imager.signal(upright(40.0 + beams * imager.beams.beam_mm, 0.0))[0])
    depth_mm = imager.beams.sample_depth_mm
    here = np.abs(imager.signal(upright(40.0, 0.0))[0])
    rows = (depth_mm > 8) & (depth_mm < 32)
    same = np.corrcoef(here[rows, 30 + beams : 100 + beams].ravel(), shifted[rows, 30:100].ravel())[0, 1]
    assert same > 0.95


def test_lumen_is_dark_and_wall_bright_where_the_beam_meets_it_squarely(tube: Anatomy) -> None:
    imager = BMode(Scanner(), TissueModel(tube, PLAIN, seed=1))
    envelope_db = (
        20
        * np.log10(np.mean([np.abs(imager.signal(upright(0.0, z))[0]) ** 2 for z in (-10, 0, 10)], axis=0))
        / 2
    )
    depth_mm = imager.beams.sample_depth_mm
    middle = imager.beams.shape[1] // 2
    centre = envelope_db[(depth_mm > 18.5) & (depth_mm < 21.5), middle - 4 : middle + 5].mean()
    beside = envelope_db[(depth_mm > 12) & (depth_mm < 28), 10:40].mean()
    wall = envelope_db[(depth_mm > 15.7) & (depth_mm < 16.2), middle - 2 : middle + 3].max()
    assert centre < beside - 20
    assert wall > beside + 6
    lateral = np.rint(imager.beams.to_grid(np.float32([-4.0, 4.0]), np.float32([20.0, 20.0]))[1]).astype(int)
    sides = envelope_db[(depth_mm > 19.5) & (depth_mm < 20.5)][:, lateral].max()
    assert sides < wall - 12


def test_grey_levels_follow_gain_and_noise_follows_its_seed(tube: Anatomy) -> None:
    model = TissueModel(tube, PLAIN, seed=1)
    quiet = BMode(replace(QUIET, height_px=96, width_px=96), model)
    louder = BMode(replace(quiet.scanner, gain_db=6.0), model)
    rng = np.random.default_rng
    first, second = quiet(upright(), rng(0)), louder(upright(), rng(0))
    between = (first > 20) & (first < 200)
    np.testing.assert_allclose(second[between].astype(float) - first[between], 255 * 6 / 60, atol=1.01)
    noisy = BMode(replace(quiet.scanner, noise_db=-10.0), model)
    np.testing.assert_array_equal(noisy(upright(), rng(4)), noisy(upright(), rng(4)))
    assert (noisy(upright(), rng(4)) != noisy(upright(), rng(5))).any()


def test_pixels_beyond_the_array_stay_black(tube: Anatomy) -> None:
    narrow = Scanner(height_px=80, width_px=120, aperture_mm=30.0)
    picture = BMode(narrow, TissueModel(tube, PLAIN, seed=1))(upright(), np.random.default_rng(0))
    assert picture.shape == (80, 120)
    assert not picture[:, :29].any()
    assert picture[:, 32:88].mean() > 60
