"""Beam geometry against hand-made values."""

from __future__ import annotations

import numpy as np
import pytest

from registration.phantom.acoustics import Scanner
from registration.phantom.beams import Beams

CONVEX = Scanner(
    geometry="convex", radius_mm=60.0, aperture_mm=62.83185307179586, depth_mm=80.0, height_px=176
)


def test_linear_beams_run_straight_down() -> None:
    beams = Beams(Scanner())
    arc_mm, range_mm = beams.to_beam(np.array([3.0]), np.array([12.0]))
    assert (arc_mm[0], range_mm[0]) == (3.0, 12.0)
    sample, beam = beams.to_grid(np.array([0.0]), np.array([0.0]))
    assert beams.sample_depth_mm[0] == pytest.approx(-sample[0] * beams.sample_mm)
    assert beams.beam_arc_mm[0] == pytest.approx(-beam[0] * beams.beam_mm)


def test_convex_beams_fan_out_of_the_centre_of_curvature() -> None:
    beams = Beams(CONVEX)
    # 30 degrees to the side, 40 mm from the face.
    place = np.array([100 * 0.5]), np.array([100 * np.sqrt(0.75) - 60])
    arc_mm, range_mm = beams.to_beam(*place)
    assert arc_mm[0] == pytest.approx(60 * np.pi / 6)
    assert range_mm[0] == pytest.approx(40)
    direction = beams.directions(np.array([[place[0][0], place[1][0], 0.0]]))[0]
    np.testing.assert_allclose(direction, [0.5, np.sqrt(0.75), 0.0], atol=1e-12)


def test_convex_face_lies_in_the_picture_and_its_ends_touch_the_top() -> None:
    beams = Beams(CONVEX)
    # Half the face subtends 30 degrees.
    assert CONVEX.sag_mm == pytest.approx(60 * (1 - np.cos(np.pi / 6)))
    seen = beams.seen
    assert not seen[0, 128]
    middle_row = int(CONVEX.sag_mm / CONVEX.pixel_mm) + 1
    assert seen[middle_row:, 128].all()
    columns = np.flatnonzero(seen[1])
    lateral_mm = beams.pixel_places_mm[0][0, columns]
    np.testing.assert_allclose(np.abs(lateral_mm[[0, -1]]), 30.0, atol=2.5)


def test_sound_speed_moves_places_along_their_beam() -> None:
    for scanner in (Scanner(), CONVEX):
        beams = Beams(scanner, sound_speed_m_s=1400.0)
        local_mm = np.array([[4.0, 20.0], [-7.0, 31.0]])
        shown_mm = beams.displayed(local_mm)
        before, after = beams.to_beam(*local_mm.T), beams.to_beam(*shown_mm.T)
        np.testing.assert_allclose(after[0], before[0])
        np.testing.assert_allclose(after[1], before[1] * 1.1)


def test_calibration_maps_pixels_to_their_places_right_handedly() -> None:
    for scanner in (Scanner(height_px=100, width_px=140), CONVEX):
        beams = Beams(scanner)
        lateral_mm, depth_mm = beams.pixel_places_mm
        probe_mm = beams.probe_A_pixel @ np.array([30.0, 70.0, 0.0, 1.0])
        np.testing.assert_allclose(probe_mm[:3], [lateral_mm[70, 30], 0.0, depth_mm[70, 30]])
        assert np.linalg.det(beams.probe_A_pixel[:3, :3]) > 0


def test_beam_is_narrowest_at_its_focus() -> None:
    beams = Beams(Scanner(focus_mm=18.0))
    widths = beams.lateral_sigma_mm(np.array([2.0, 18.0, 40.0]))
    assert widths[1] < widths[0]
    assert widths[1] < widths[2]
    assert 2.3548 * widths[1] == pytest.approx(Scanner().wavelength_mm * Scanner().f_number)
