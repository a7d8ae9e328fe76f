"""Statistics of the pictures: speckle by its theory, lumen and wall by what they must look like."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.phantom.acoustics import Artefacts, Scanner, Tissue
from registration.phantom.anatomy import Anatomy, from_lines
from registration.phantom.bmode import BMode
from registration.phantom.deformation import View
from registration.phantom.shapes import spline_line
from registration.phantom.simulator import PROBE_T_IMAGE
from registration.phantom.tissue import TissueModel

PLAIN = Tissue(
    texture_db=0.0,
    mottle_db=0.0,
    fascia_count=0,
    streaks_per_mm=0.0,
    attenuation_db_cm_mhz=0.5,
    compensation_db_cm_mhz=0.5,
)
OFF = Artefacts(clutter_db=-120.0, reverberation_db=-120.0, contact_loss_mm=0.0, shadows=0, edge_shadow=1.0)
QUIET = Scanner(noise_db=-120.0, looks=1)


@pytest.fixture(scope="module")
def tube() -> Anatomy:
    """A straight tube 8 mm across, 20 mm below the skin, along z."""
    line = spline_line(np.array([[0.0, 0, -40], [0, 0, 40]]), np.full(2, 4.0))
    return from_lines((line,), -20.0)


def camera(
    tube: Anatomy, scanner: Scanner = QUIET, artefacts: Artefacts = OFF, seed: int = 3, **tissue: float
) -> BMode:
    return BMode(scanner, TissueModel(tube, replace(PLAIN, **tissue), artefacts, seed))


def above(x_mm: float = 0.0, z_mm: float = 0.0, turn_deg: float = 0.0, depth_mm: float = 0.0) -> View:
    """The view of a probe on the skin that looks to the back, turned about the depth axis."""
    upright = Rotation.from_matrix([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    turned = upright * Rotation.from_euler("z", turn_deg, degrees=True)
    return View(transforms.from_rotation(turned, np.array([x_mm, depth_mm - 20.0, z_mm])) @ PROBE_T_IMAGE)


def contact(imager: BMode) -> np.ndarray:
    return np.zeros(imager.beams.shape[1], dtype=np.float32)


def tissue_samples(imager: BMode, view: View) -> np.ndarray:
    """Envelope of tissue well away from vessel, skin and the grid's ends."""
    depth_mm = imager.beams.sample_depth_mm
    envelope = np.abs(imager.echo(view).signal[0])
    return envelope[(depth_mm > 8) & (depth_mm < 32)][:, 12:-12]


@pytest.mark.parametrize("turn_deg", [0.0, 33.0])
def test_speckle_is_fully_developed(tube: Anatomy, turn_deg: float) -> None:
    imager = camera(tube)
    patches = [
        tissue_samples(imager, above(x_mm, z_mm, turn_deg)) for x_mm, z_mm in ((45, 0), (-45, 9), (50, -9))
    ]
    samples = np.concatenate([patch.ravel() for patch in patches])
    assert samples.mean() / samples.std() == pytest.approx(1.91, rel=0.05)
    # Average tissue is the reference of all levels.
    assert np.mean(samples**2) == pytest.approx(1.0, rel=0.1)
    # Far enough apart to be independent, a few hundred samples fit the Rayleigh law.
    apart = np.concatenate([patch[::14, ::9].ravel() for patch in patches])
    assert len(apart) > 300
    assert stats.kstest(apart / np.sqrt(np.mean(apart**2) / 2), "rayleigh").pvalue > 0.01


def test_compounding_smooths_speckle(tube: Anatomy) -> None:
    imager = camera(tube, replace(QUIET, looks=3))
    power = np.mean(np.abs(imager.echo(above(45.0)).signal) ** 2, axis=0)[60:-60, 12:-12]
    single = np.abs(imager.echo(above(45.0)).signal[1])[60:-60, 12:-12]
    assert np.sqrt(power).mean() / np.sqrt(power).std() > 1.25 * single.mean() / single.std()


def test_speckle_belongs_to_the_tissue_and_decorrelates_with_distance(tube: Anatomy) -> None:
    imager = camera(tube)
    start = tissue_samples(imager, above(45.0))
    correlations = [
        np.corrcoef(start.ravel(), tissue_samples(imager, above(45.0, step_mm)).ravel())[0, 1]
        for step_mm in (0.0, 0.3, 1.0, 4.0)
    ]
    assert correlations[0] == pytest.approx(1.0)
    assert correlations[0] > correlations[1] > correlations[2] > correlations[3]
    assert correlations[1] > 0.8
    assert abs(correlations[3]) < 0.1
    # Sideways by whole beams, the same speckle appears shifted.
    shifted = tissue_samples(imager, above(45.0 + 10 * imager.beams.beam_mm))
    assert np.corrcoef(start[:, 30:100].ravel(), shifted[:, 20:90].ravel())[0, 1] > 0.95


def test_lumen_is_dark_and_wall_bright_where_the_beam_meets_it_squarely(tube: Anatomy) -> None:
    imager = camera(tube)
    power = np.mean([np.abs(imager.echo(above(0.0, z)).signal[0]) ** 2 for z in (-10, 0, 10)], axis=0)
    level_db = 10 * np.log10(power)
    depth_mm, arc_mm = imager.beams.sample_depth_mm, imager.beams.beam_arc_mm

    def part(deep: tuple[float, float], wide: tuple[float, float]) -> np.ndarray:
        rows = (depth_mm > deep[0]) & (depth_mm < deep[1])
        return level_db[np.ix_(rows, (arc_mm > wide[0]) & (arc_mm < wide[1]))]

    beside = part((12, 28), (-18, -9)).mean()
    assert part((18, 22), (-1, 1)).mean() < beside - 20
    assert part((15.7, 16.3), (-0.5, 0.5)).max() > beside + 8
    assert part((23.7, 24.3), (-0.5, 0.5)).max() > beside + 8
    # Side walls drop out, unless the fall with angle is switched off.
    sides = part((19.7, 20.3), (3.6, 4.4)).max()
    assert sides < part((15.7, 16.3), (-0.5, 0.5)).max() - 12
    all_round = camera(tube, wall_exponent=0.0)
    lit = 20 * np.log10(np.abs(all_round.echo(above()).signal[0]))
    rows = (depth_mm > 19.7) & (depth_mm < 20.3)
    assert lit[np.ix_(rows, (arc_mm > 3.6) & (arc_mm < 4.4))].max() > sides + 8


def test_tissue_behind_the_lumen_is_brighter_and_behind_a_hard_spot_dark(tube: Anatomy) -> None:
    imager = camera(tube)
    echo = imager.echo(above())
    behind = np.argmin(np.abs(imager.beams.sample_depth_mm - 35))
    middle, side = (np.argmin(np.abs(imager.beams.beam_arc_mm - arc)) for arc in (0.0, 15.0))
    # 8 mm of blood, both ways, at 9 MHz: 0.35 dB/cm/MHz less than tissue.
    assert echo.loss_db[behind, side] - echo.loss_db[behind, middle] == pytest.approx(0.35 * 9 * 1.6, rel=0.2)
    spotted = camera(tube, artefacts=replace(OFF, shadows=1, shadow_mm=3.0))
    x_mm, y_mm, z_mm = spotted.tissue.hard_spots_mm[0]
    echo = spotted.echo(above(float(x_mm), float(z_mm)))
    deep = np.argmin(np.abs(spotted.beams.sample_depth_mm - (y_mm + 20 + 6)))
    middle, side = (np.argmin(np.abs(spotted.beams.beam_arc_mm - arc)) for arc in (0.0, 10.0))
    assert echo.loss_db[deep, middle] > echo.loss_db[deep, side] + 12
    picture, hidden = spotted(above(float(x_mm), float(z_mm)), contact(spotted), np.random.default_rng(0))
    row = int((y_mm + 20 + 6) / spotted.scanner.pixel_mm)
    assert hidden[row, 127:129].all()
    assert not hidden[: int((y_mm + 16) / spotted.scanner.pixel_mm)].any()
    assert picture[row, 122:134].mean() < picture[row, 20:100].mean() - 20


def test_reverberation_repeats_an_interface_at_its_distance(tube: Anatomy) -> None:
    with_copy = camera(tube, artefacts=replace(OFF, reverberation_db=-15.0, reverberation_mm=3.0))
    row = np.argmin(np.abs(with_copy.beams.sample_depth_mm - 19.0))
    middle = with_copy.beams.shape[1] // 2
    window = (slice(row - 3, row + 4), slice(middle - 3, middle + 4))
    clean, repeated = (np.abs(one.echo(above()).signal[0])[window].max() for one in (camera(tube), with_copy))
    assert repeated > 3 * clean


def test_clutter_fills_the_lumen(tube: Anatomy) -> None:
    hazy = camera(tube, artefacts=replace(OFF, clutter_db=-8.0))
    rows = (hazy.beams.sample_depth_mm > 18) & (hazy.beams.sample_depth_mm < 22)
    middle = hazy.beams.shape[1] // 2
    clouded, clear = (
        10 * np.log10(np.mean(np.abs(one.echo(above()).signal[0])[rows, middle - 4 : middle + 5] ** 2))
        for one in (hazy, camera(tube))
    )
    # What comes from 8 mm of lumen is missing in the haze, which is 3 to 9 mm wide.
    assert clear == pytest.approx(-30, abs=2)
    assert -20 < clouded < -9


def test_beams_without_contact_show_rings_and_no_tissue(tube: Anatomy) -> None:
    imager = camera(tube)
    lost = contact(imager)
    lost[: len(lost) // 3] = 30.0
    picture, hidden = imager(above(), lost, np.random.default_rng(0))
    assert hidden[100:, :50].all()
    assert not hidden[:, 150:].any()
    assert picture[100:, 5:50].mean() < 10
    assert picture[:40, 5:50].max() > 60


def test_grey_levels_follow_gain_and_noise_follows_its_seed(tube: Anatomy) -> None:
    plain = replace(QUIET, height_px=96, width_px=96, gamma=1.0)
    first, second = (
        camera(tube, replace(plain, gain_db=gain))(
            above(), contact(camera(tube, plain)), np.random.default_rng(0)
        )[0]
        for gain in (0.0, 6.0)
    )
    between = (first > 20) & (first < 200)
    np.testing.assert_allclose(second[between].astype(float) - first[between], 255 * 6 / 66, atol=1.01)
    noisy = camera(tube, replace(plain, noise_db=-3.0))
    again = [noisy(above(), contact(noisy), np.random.default_rng(seed))[0] for seed in (4, 4, 5)]
    np.testing.assert_array_equal(again[0], again[1])
    assert (again[0] != again[2]).any()


def test_slow_tissue_shows_the_vessel_deeper(tube: Anatomy) -> None:
    """Echoes take longer through tissue at 1400 m/s: what lies at 16 mm is drawn at 16 * 1540 / 1400."""
    slow = camera(tube, sound_speed_m_s=1400.0)
    middle = slow.beams.shape[1] // 2
    course = np.abs(slow.echo(above()).signal[0])[:, middle - 2 : middle + 3].mean(axis=1)
    depth_mm = slow.beams.sample_depth_mm
    near = (depth_mm > 14) & (depth_mm < 20)
    assert depth_mm[near][course[near].argmax()] == pytest.approx(16 * 1.1, abs=0.15)


def test_pixels_beyond_the_array_stay_black(tube: Anatomy) -> None:
    imager = camera(tube, Scanner(height_px=80, width_px=120, aperture_mm=30.0))
    picture, _ = imager(above(), contact(imager), np.random.default_rng(0))
    assert picture.shape == (80, 120)
    assert not picture[:, :29].any()
    assert picture[:, 32:88].mean() > 30


def test_convex_array_shows_a_sector_with_the_vessel_in_place(tube: Anatomy) -> None:
    scanner = Scanner(
        geometry="convex", radius_mm=50, aperture_mm=50, depth_mm=45, frequency_mhz=5.0, looks=1
    )
    imager = camera(tube, scanner)
    picture, _ = imager(above(depth_mm=scanner.sag_mm), contact(imager), np.random.default_rng(0))
    assert not picture[~imager.beams.seen].any()
    lateral_mm, depth_mm = imager.beams.pixel_places_mm
    from_axis_mm = np.hypot(lateral_mm, depth_mm + scanner.sag_mm - 20.0)
    assert picture[from_axis_mm < 2.5].mean() < 12
    assert picture[(from_axis_mm > 6) & imager.beams.seen & (depth_mm > 5)].mean() > 35
