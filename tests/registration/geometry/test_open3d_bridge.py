"""Distances and rays to a cube's triangles, whose values are known, near the origin and far from it."""

from __future__ import annotations

import numpy as np
import pytest

from registration.geometry.open3d_bridge import TriangleScene, point_body, triangle_body
from registration.geometry.shapes import Mesh

CORNERS = np.array([[x, y, z] for x in (0.0, 2.0) for y in (0.0, 2.0) for z in (0.0, 2.0)])
# Two triangles a side, wound so that their normals point out.
TRIANGLES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5]),
        *([0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6]),
        *([0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)


def cube(at_mm: float) -> Mesh:
    return Mesh(CORNERS + at_mm, TRIANGLES)


@pytest.mark.parametrize("at_mm", [0.0, 4096.0])
def test_distances_inside_and_rays_of_a_cube(at_mm: float) -> None:
    scene = TriangleScene(cube(at_mm))
    points_mm = np.array([[1.0, 1.25, 1.75], [1.0, 0.5, 3.5], [5.0, 6.0, 1.0]]) + at_mm
    np.testing.assert_allclose(scene.distance_mm(points_mm), [0.25, 1.5, 5.0], atol=1e-5)
    assert scene.occupied(points_mm).tolist() == [True, False, False]
    lengths_mm, met = scene.cast(points_mm[:2], np.array([[1.0, 0, 0], [0, 1, 0]]))
    np.testing.assert_allclose(lengths_mm, [1.0, np.inf], atol=1e-5)
    assert met[0] in (2, 3)


def test_the_closest_place_has_its_triangle_weights_and_normal() -> None:
    mesh = cube(100.0)
    points_mm = np.array([[101.0, 100.5, 103.5], [99.0, 101.5, 100.5]])
    found = TriangleScene(mesh).closest(points_mm)
    np.testing.assert_allclose(found.places_mm, [[101.0, 100.5, 102.0], [100.0, 101.5, 100.5]], atol=1e-5)
    np.testing.assert_allclose(found.offsets_mm, found.places_mm - points_mm, atol=1e-5)
    np.testing.assert_allclose(found.normals, [[0, 0, 1], [-1, 0, 0]], atol=1e-6)
    weights = np.column_stack([1 - found.second_third.sum(axis=1), found.second_third])
    placed_mm = np.einsum("nc,nck->nk", weights, mesh.corners_mm[found.triangles])
    np.testing.assert_allclose(placed_mm, found.places_mm, atol=1e-4)


def test_points_of_a_grid_keep_their_shape() -> None:
    points_mm = np.stack(np.meshgrid([0.5, 3.0], [0.5, 1.0], [1.0], indexing="ij"), axis=-1)
    scene = TriangleScene(cube(0.0), np.zeros(3))
    assert scene.distance_mm(points_mm).shape == (2, 2, 1)
    assert scene.occupied(points_mm)[:, 0, 0].tolist() == [True, False]


def test_bodies_hold_the_same_numbers() -> None:
    mesh = cube(7.0)
    body = triangle_body(mesh)
    np.testing.assert_array_equal(np.asarray(body.vertices), mesh.vertices_mm)
    np.testing.assert_array_equal(np.asarray(body.triangles), mesh.triangles)
    normals = np.tile([0.0, 0, 1], (8, 1))
    np.testing.assert_array_equal(np.asarray(point_body(mesh.vertices_mm, normals).normals), normals)
    assert not point_body(mesh.vertices_mm).has_normals()
