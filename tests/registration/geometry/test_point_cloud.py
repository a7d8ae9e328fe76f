"""Clouds with normals: parts of them, normals found, normals corrected."""

from __future__ import annotations

import numpy as np
import pytest
from tubes import straight, tube

from registration.errors import InputError
from registration.geometry.point_cloud import (
    OrientedCloud,
    require_oriented,
    take,
    with_normals,
    with_surface_normals,
)
from registration.reconstruction.contours import ContourExtractor
from registration.reconstruction.open_ends import vertex_normals


def cone() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points of a cone that widens by half a mm a mm along z, its true normals, and those within each section."""
    angle, z = np.meshgrid(2 * np.pi * np.arange(60) / 60, np.arange(0, 20, 0.4))
    angle, z = angle.ravel(), z.ravel()
    radius = 3 + 0.5 * z
    around = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(z)], axis=1)
    points = around * radius[:, None] + np.stack([0 * z, 0 * z, z], axis=1)
    true = (around - [0, 0, 0.5]) / np.sqrt(1.25)
    return points, true, around


def test_normals_within_sections_are_turned_to_the_surface() -> None:
    points, true, within = cone()
    cloud = with_surface_normals(OrientedCloud(points, within), 1.5)
    inner = (points[:, 2] > 2) & (points[:, 2] < 18)
    assert np.einsum("pi,pi->p", within, true).max() < 0.9
    assert np.einsum("pi,pi->p", cloud.normals, true)[inner].min() > 0.99
    lonely = OrientedCloud(np.concatenate([points, [[99.0, 0, 0]]]), np.concatenate([within, [[0, 1.0, 0]]]))
    np.testing.assert_allclose(with_surface_normals(lonely, 1.5).normals[-1], [0, 1, 0])


def test_normals_found_point_out_of_a_tube() -> None:
    mesh = tube(straight(40.0), 4.0)
    found = with_normals(mesh.vertices_mm)
    assert np.einsum("pi,pi->p", found.normals, vertex_normals(mesh)).min() > 0.9


def test_taking_points_keeps_all_that_is_known_of_them() -> None:
    mask = np.zeros((2, 30, 30), dtype=bool)
    mask[:, 8:22, 8:22] = True
    cloud = ContourExtractor()(mask, np.stack([np.eye(4)] * 2))
    chosen = np.array([3, len(cloud) - 1])
    part = take(cloud, chosen)
    assert part.frame_index.tolist() == [0, 1]
    np.testing.assert_array_equal(part.points_mm, cloud.points_mm[chosen])
    assert part.world_A_pixel is cloud.world_A_pixel


def test_normals_must_have_length_one() -> None:
    points, true, _ = cone()
    assert require_oriented(OrientedCloud(points, true)).points_mm is points
    with pytest.raises(InputError, match="cloud: expected normals of length one, received 3000 others"):
        require_oriented(OrientedCloud(points, 2 * true))
    with pytest.raises(InputError, match="cloud: expected normals of length one"):
        require_oriented(OrientedCloud(points, true * np.nan))
    with pytest.raises(InputError, match="reach_mm"):
        with_surface_normals(OrientedCloud(points, true), 0.0)
