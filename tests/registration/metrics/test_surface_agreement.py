"""Tubes of known distance and overlap, both ways; the rim of an open end is no counterpart."""

from __future__ import annotations

import numpy as np
import pytest
from tubes import straight, tube

from registration.errors import InputError
from registration.geometry.shapes import Mesh
from registration.metrics.surface_agreement import counterparts, surface_agreement

AXIS_MM = straight(40.0)
TUBE = tube(AXIS_MM, 4.0, around=64)


def test_two_radii_are_their_difference_apart() -> None:
    found = surface_agreement(TUBE, tube(AXIS_MM, 4.5, around=64))
    # Tubes of 64 sides: middles of sides lie nearer to the axis by a factor of cos(pi / 64).
    for value in (found.msd_mm, found.hd95_mm, found.msd_covered_mm, found.hd95_covered_mm):
        assert value == pytest.approx(0.5, abs=0.01)
    assert found.covered_first == pytest.approx(1.0, abs=0.01)
    assert found.covered_second == pytest.approx(1.0, abs=0.01)


def test_half_a_tube_agrees_where_it_is() -> None:
    half = tube(AXIS_MM[: len(AXIS_MM) // 2 + 1], 4.0, around=64)
    found = surface_agreement(TUBE, half)
    assert found.hd95_covered_mm < 1e-3
    assert found.covered_first == pytest.approx(0.5, abs=0.02)
    assert found.covered_second == 1.0
    # The farthest tenth of the whole lies 18 to 20 mm past the half.
    assert found.hd95_mm == pytest.approx(18.0, abs=0.5)
    other = surface_agreement(half, TUBE)
    assert (other.covered_first, other.covered_second) == pytest.approx((1.0, 0.5), abs=0.02)


def test_a_hole_in_the_wall_is_no_end() -> None:
    away_mm = np.linalg.norm(TUBE.corners_mm.mean(axis=1) - TUBE.vertices_mm[64 * 25], axis=1)
    holed = Mesh(TUBE.vertices_mm, TUBE.triangles[away_mm > 2.0])
    found = counterparts(TUBE.vertices_mm[64 * 25][None], holed)
    assert found.apart_mm[0] > 1.0
    assert found.covered.all()


def test_counterparts_of_known_points() -> None:
    along = (AXIS_MM[-1] - AXIS_MM[0]) / np.linalg.norm(AXIS_MM[-1] - AXIS_MM[0])
    outside_mm = TUBE.vertices_mm[64 * 10] + 2 * (TUBE.vertices_mm[64 * 10] - AXIS_MM[10]) / 4.0
    past_mm = TUBE.vertices_mm[0] - 3 * along
    found = counterparts(np.stack([outside_mm, past_mm]), TUBE)
    np.testing.assert_allclose(found.apart_mm, [2.0, 3.0], atol=1e-4)
    np.testing.assert_allclose(found.points_mm, TUBE.vertices_mm[[64 * 10, 0]], atol=1e-4)
    assert found.covered.tolist() == [True, False]


def test_surfaces_without_a_common_part_are_refused() -> None:
    along = (AXIS_MM[-1] - AXIS_MM[0]) / np.linalg.norm(AXIS_MM[-1] - AXIS_MM[0])
    beyond = Mesh(TUBE.vertices_mm + 50 * along, TUBE.triangles)
    with pytest.raises(InputError, match="surfaces: expected two that show a common part, received none"):
        surface_agreement(TUBE, beyond)
    with pytest.raises(InputError, match="samples: expected a whole number of at least 1, received 0"):
        surface_agreement(TUBE, TUBE, samples=0)
