"""The distance grid of a tube against its formula."""

from __future__ import annotations

import numpy as np
import pytest

from registration.phantom.distance import DistanceGrid, distance_grid
from registration.phantom.shapes import spline_line, surround


@pytest.fixture(scope="module")
def grid() -> DistanceGrid:
    line = spline_line(np.array([[10.0, -5, 0], [10, -5, 20]]), np.full(2, 4.0))
    return distance_grid(surround((line,), pitch_mm=0.3))


def test_distance_and_sign(grid: DistanceGrid) -> None:
    rng = np.random.default_rng(0)
    points_mm = rng.uniform([4, -11, 2], [16, 1, 18], (4000, 3)).astype(np.float32)
    expected_mm = np.hypot(points_mm[:, 0] - 10, points_mm[:, 1] + 5) - 4.0
    expected_mm = np.clip(expected_mm, -grid.far_mm, grid.far_mm)
    near = np.abs(expected_mm) < grid.far_mm - 0.9
    np.testing.assert_allclose(grid.at(points_mm)[near], expected_mm[near], atol=0.04)
    np.testing.assert_allclose(grid.at(points_mm), expected_mm, atol=0.25)


def test_far_outside_is_capped(grid: DistanceGrid) -> None:
    np.testing.assert_array_equal(
        grid.at(np.array([[100.0, 0, 0], [-50.0, 3, 2]])), np.float32([grid.far_mm] * 2)
    )
    assert len(grid.at(np.empty((0, 3)))) == 0


def test_normals_point_away_from_the_axis(grid: DistanceGrid) -> None:
    angle = np.linspace(0, 2 * np.pi, 50)
    points_mm = np.column_stack([10 + 4 * np.cos(angle), -5 + 4 * np.sin(angle), np.full(50, 9.0)])
    expected = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(50)])
    assert (np.einsum("ni,ni->n", grid.normals(points_mm), expected) > 0.99).all()
