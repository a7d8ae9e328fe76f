"""Positions and slabs along a vessel, by shapes whose axis is known."""

from __future__ import annotations

import numpy as np
import pytest

from registration.errors import InputError
from registration.geometry.shapes import Mesh
from registration.geometry.vessel_axis import AlongVessel

# A box of 10 by 2 by 1 mm whose long side is the oblique direction (0.6, 0.8, 0).
LONG, ACROSS = np.array([0.6, 0.8, 0.0]), np.array([-0.8, 0.6, 0.0])
CORNERS = np.array([a * LONG + b * ACROSS + [0, 0, c] for a in (5.0, 15) for b in (0.0, 2) for c in (0.0, 1)])


def test_the_ruler_lies_along_the_longest_side() -> None:
    along = AlongVessel.of(CORNERS)
    np.testing.assert_allclose(along.axis, LONG, atol=1e-12)
    assert (along.first_mm, along.last_mm, along.length_mm) == pytest.approx((5, 15, 10))
    np.testing.assert_allclose(along.position_mm(np.array([7 * LONG + 3 * ACROSS])), [7])


def test_a_mesh_is_measured_by_the_vertices_in_use() -> None:
    triangles = np.array([[0, 2, 4], [2, 4, 6], [1, 3, 5], [3, 5, 7]])
    spare = np.concatenate([CORNERS, 900 * LONG[None]])
    assert AlongVessel.of(Mesh(spare, triangles)).last_mm == pytest.approx(15)


def test_slabs_are_equal_and_hold_both_ends() -> None:
    along = AlongVessel(LONG, 5.0, 15.0)
    points = np.array([4.0, 5, 6.9, 7.1, 14.9, 15, 16])[:, None] * LONG
    assert along.slab(points, 5).tolist() == [0, 0, 0, 1, 4, 4, 4]


def test_what_has_no_length_or_no_slabs_is_refused() -> None:
    with pytest.raises(InputError, match="last_mm: expected above first_mm, 3, received 3"):
        AlongVessel(LONG, 3.0, 3.0)
    with pytest.raises(InputError, match="count: expected a whole number of at least 1"):
        AlongVessel(LONG, 5.0, 15.0).slab(CORNERS, 0)
