"""Bounds, and surfaces with fewer triangles."""

from __future__ import annotations

import numpy as np
import pytest
from tubes import straight, tube

from experiments.reporting.scene_data import bounds_of, core_bounds_of, decimated, view_eye
from registration.geometry.mesh_topology import borders
from registration.geometry.shapes import Mesh
from registration.metrics.surface_distance import surface_residuals

TUBE = tube(straight(40.0, 0.4), 4.0, around=64)


def test_bounds_are_the_lowest_and_highest_coordinates() -> None:
    np.testing.assert_array_equal(bounds_of(np.array([[1.0, 5, 3], [2, 4, 9]])), [[1, 4, 3], [2, 5, 9]])


def test_the_core_leaves_out_single_points_far_away() -> None:
    points_mm = np.random.default_rng(0).uniform(-1.0, 1.0, (200, 3))
    far_mm = np.concatenate([points_mm, [[50.0, 0, 0], [0, -40, 0]]])
    found_mm, outliers = core_bounds_of(far_mm)
    np.testing.assert_array_equal(found_mm, bounds_of(points_mm))
    assert outliers == 2
    np.testing.assert_array_equal(core_bounds_of(TUBE.vertices_mm)[0], bounds_of(TUBE.vertices_mm))


@pytest.mark.parametrize("count", [0, 1])
def test_points_in_one_place_are_all_of_the_core(count: int) -> None:
    points_mm = np.concatenate([np.ones((40, 3)), np.full((count, 3), 7.0)])
    found_mm, outliers = core_bounds_of(points_mm)
    np.testing.assert_array_equal(found_mm, bounds_of(points_mm))
    assert outliers == 0


def test_a_cube_is_seen_from_so_many_radii() -> None:
    eye = view_eye(np.array([5.0, 5.0, 5.0]))
    assert np.linalg.norm(list(eye.values())) == pytest.approx(2.85 * np.sqrt(3) / 2)


@pytest.mark.parametrize("max_triangles", [6000, 2000])
def test_an_open_tube_keeps_its_shape_and_its_ends(max_triangles: int) -> None:
    # 12800 triangles: the second choice is past what is done edge by edge.
    fewer, values = decimated(TUBE, None, max_triangles)
    assert values is None
    assert 0.3 * max_triangles < len(fewer.triangles) <= max_triangles
    apart = surface_residuals(fewer, TUBE, np.eye(4), inlier_mm=1.0, keep=1.0)
    assert apart.hd95_mm < 0.3
    assert sum(border.is_end for border in borders(fewer)) == 2


def test_a_mesh_that_is_small_enough_stays_as_it_is() -> None:
    values = np.arange(len(TUBE.vertices_mm), dtype=np.float64)
    same, kept = decimated(TUBE, values, len(TUBE.triangles))
    assert same is TUBE and kept is values


def test_values_come_from_where_they_were() -> None:
    fewer, values = decimated(Mesh(TUBE.vertices_mm, TUBE.triangles), TUBE.vertices_mm[:, 0], 2000)
    assert values is not None
    np.testing.assert_allclose(values, fewer.vertices_mm[:, 0], atol=0.5)
