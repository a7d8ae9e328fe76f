"""The fixed points at which every method is measured: the same ones, and where a centerline lies on it."""

from __future__ import annotations

import numpy as np
from vessels import bent_tube

from registration.geometry.shapes import Centerline, Mesh, Polyline
from registration.metrics.targets import MAX_TARGETS, target_points


def test_points_of_a_cloud_are_drawn_from_it_each_once() -> None:
    cloud_mm = np.arange(3 * 900.0).reshape(-1, 3)
    found_mm = target_points(cloud_mm)
    assert len(np.unique(found_mm, axis=0)) == len(found_mm) == MAX_TARGETS
    assert set(map(tuple, found_mm)) <= set(map(tuple, cloud_mm))
    np.testing.assert_array_equal(found_mm, target_points(cloud_mm, seed=0))
    assert not np.array_equal(found_mm, target_points(cloud_mm, seed=1))
    few_mm = cloud_mm[:7]
    assert set(map(tuple, target_points(few_mm))) == set(map(tuple, few_mm))


def test_points_of_a_mesh_lie_on_its_triangles_by_area() -> None:
    # A triangle of nine times the area beside a small one, in planes of their own.
    vertices_mm = np.array([[0.0, 0, 0], [9, 0, 0], [0, 2, 0], [0, 0, 5], [1, 0, 5], [0, 2, 5]])
    mesh = Mesh(vertices_mm, np.array([[0, 1, 2], [3, 4, 5]]))
    found_mm = target_points(mesh)
    assert found_mm.shape == (MAX_TARGETS, 3)
    large = found_mm[:, 2] == 0
    np.testing.assert_allclose(found_mm[~large, 2], 5.0)
    assert 0.85 < large.mean() < 0.95
    x, y = found_mm[large, 0] / 9, found_mm[large, 1] / 2
    assert (x >= 0).all() and (y >= 0).all() and (x + y <= 1 + 1e-12).all()
    np.testing.assert_array_equal(found_mm, target_points(mesh, seed=0))
    assert not np.array_equal(found_mm, target_points(mesh, seed=1))


def test_points_of_a_centerline_are_taken_before_those_of_the_surface() -> None:
    line = Centerline((Polyline(np.array([[0.0, 0, 0], [0, 0, 10], [0, 0, 499]]), np.ones(3)),))
    for surface in (bent_tube(), np.ones((5, 3))):
        found_mm = target_points(surface, line)
        assert 400 < len(found_mm) <= MAX_TARGETS
        np.testing.assert_array_equal(found_mm[:, :2], 0.0)
        steps_mm = np.diff(np.sort(found_mm[:, 2]))
        np.testing.assert_allclose(steps_mm, steps_mm[0])
