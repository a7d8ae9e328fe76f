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


NO_COMMON_PART = r"^surfaces: expected two that show a common part, received none$"


def rectangle(length_mm: float, width_mm: float, tilt: float = 0.0, side: int = 9) -> Mesh:
    """A rectangle from the origin on, tilted about the second axis, of ``side`` times ``side`` vertices."""
    along = np.array([np.cos(tilt), 0.0, np.sin(tilt)]) * length_mm
    steps = np.linspace(0, 1, side)
    vertices_mm = steps[:, None, None] * along + steps[None, :, None] * np.array([0.0, width_mm, 0.0])
    first = (side * np.arange(side - 1)[:, None] + np.arange(side - 1)).ravel()
    lower, upper = ([0, side, side + 1], [0, side + 1, 1])
    triangles = np.concatenate([first[:, None] + corners for corners in (lower, upper)])
    return Mesh(vertices_mm.reshape(-1, 3), triangles)


def test_two_radii_are_their_difference_apart() -> None:
    found = surface_agreement(TUBE, tube(AXIS_MM, 4.8, around=64))
    # Tubes of 64 sides: middles of sides lie nearer to the axis by a factor of cos(pi / 64).
    for value in (found.msd_mm, found.hd95_mm, found.msd_covered_mm, found.hd95_covered_mm):
        assert value == pytest.approx(0.8, abs=0.01)
    assert found.covered_first == pytest.approx(1.0, abs=0.01)
    assert found.covered_second == pytest.approx(1.0, abs=0.01)


def test_half_a_tube_agrees_where_it_is() -> None:
    half = tube(AXIS_MM[: len(AXIS_MM) // 2 + 1], 4.0, around=64)
    found = surface_agreement(TUBE, half)
    assert found.hd95_covered_mm < 1e-3
    assert found.covered_first == pytest.approx(0.5, abs=0.02)
    assert found.covered_second == 1.0
    # The farthest tenth of the whole lies 18 to 20 mm past the half.
    assert found.hd95_mm == pytest.approx(18.0, abs=0.25)
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
    with pytest.raises(InputError, match=NO_COMMON_PART):
        surface_agreement(TUBE, beyond)
    with pytest.raises(InputError, match="samples: expected a whole number of at least 1, received 0"):
        surface_agreement(TUBE, TUBE, samples=0)


def test_percentiles_of_two_rectangles_that_meet_at_an_angle() -> None:
    """From the tilted one the distance grows by the sine along 10 mm, back by it along 10 mm over the cosine."""
    tilt = 0.2
    found = surface_agreement(rectangle(12, 10), rectangle(10, 10, tilt), samples=100_000)
    assert found.hd95_covered_mm == pytest.approx(0.95 * 10 * np.tan(tilt), abs=0.01)
    assert found.msd_covered_mm == pytest.approx(0.5 * (5 * np.sin(tilt) + 5 * np.tan(tilt)), abs=0.01)
    assert found.covered_first == pytest.approx(10 / np.cos(tilt) / 12, abs=0.02)
    assert found.covered_second == pytest.approx(1.0, abs=0.02)


def test_a_part_that_is_common_from_one_side_alone_is_none() -> None:
    """Over the middle of the large rectangle, of which no point that is drawn has the small one as counterpart."""
    small = rectangle(1e-3, 1e-3)
    speck = Mesh(small.vertices_mm + np.array([6.0, 5.0, 1.0]), small.triangles)
    for first, second in ((speck, rectangle(12, 10)), (rectangle(12, 10), speck)):
        with pytest.raises(InputError, match=NO_COMMON_PART):
            surface_agreement(first, second, samples=50)


def test_the_seed_decides_which_points_are_compared() -> None:
    first, second = rectangle(12, 10), rectangle(10, 10, 0.2)
    assert surface_agreement(first, second) == surface_agreement(first, second, samples=10_000, seed=0)
    assert surface_agreement(first, second, seed=3) == surface_agreement(first, second, seed=3)
    assert surface_agreement(first, second, seed=3) != surface_agreement(first, second, seed=4)
