"""Lines carried on to the end of a closed tube."""

from __future__ import annotations

import numpy as np
import pytest
from tubes import straight, tube

from registration.centerline.end_extension import extend_to_closed_end, reversed_line
from registration.centerline.vessel_walls import Walls
from registration.geometry.mesh_topology import borders, with_caps
from registration.geometry.shapes import Polyline

LINE_MM = straight(40.0)
OPEN = tube(LINE_MM, 4.0)
WALLS = Walls(OPEN, with_caps(OPEN, borders(OPEN)))
INNER = Polyline(LINE_MM[5:-5], np.linspace(3.0, 4.0, len(LINE_MM[5:-5])))


def test_it_ends_on_the_cap_and_keeps_its_radius() -> None:
    found = extend_to_closed_end(INNER, WALLS, 0.8)
    np.testing.assert_allclose(found.points_mm[-1], LINE_MM[-1], atol=1e-3)
    np.testing.assert_array_equal(found.points_mm[: len(INNER.points_mm)], INNER.points_mm)
    np.testing.assert_allclose(found.radius_mm[len(INNER.radius_mm) :], 4.0)
    np.testing.assert_allclose(np.diff(found.arc_mm), 0.8, atol=1e-3)


def test_the_other_end_by_way_of_the_line_turned_round() -> None:
    found = reversed_line(extend_to_closed_end(reversed_line(INNER), WALLS, 0.8))
    np.testing.assert_allclose(found.points_mm[0], LINE_MM[0], atol=1e-3)
    assert found.length_mm == pytest.approx(INNER.length_mm + 4.0, abs=1e-3)
    assert found.radius_mm[0] == 3.0


def test_it_stays_where_the_wall_ahead_is_far_or_there_is_none() -> None:
    short = Polyline(LINE_MM[5:20], np.full(15, 4.0))
    assert extend_to_closed_end(short, WALLS, 0.8) is short
    outside = Polyline(LINE_MM[:10] + 100.0, np.full(10, 4.0))
    assert extend_to_closed_end(outside, WALLS, 0.8) is outside
    still = Polyline(np.repeat(LINE_MM[5:6], 2, axis=0), np.full(2, 4.0))
    assert extend_to_closed_end(still, WALLS, 0.8) is still
