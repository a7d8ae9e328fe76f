"""Rough lines through tubes are brought to the middle."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree
from tubes import helix, straight, tube

from registration.centerline.refinement import refine, resample
from registration.centerline.vessel_walls import Walls
from registration.geometry.mesh_topology import borders, with_caps


def walls_of(line_mm: np.ndarray, radius_mm: float) -> Walls:
    mesh = tube(line_mm, radius_mm, around=48)
    return Walls(mesh, with_caps(mesh, borders(mesh)))


def test_resampling_keeps_ends_and_steps() -> None:
    bent_mm = np.array([[0.0, 0, 0], [3, 0, 0], [3, 4, 0]])
    points_mm = resample(bent_mm, 1.0)
    np.testing.assert_allclose(points_mm[[0, 3, -1]], bent_mm, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(np.diff(points_mm, axis=0), axis=1), 1.0)
    assert len(resample(bent_mm[:2], 100.0)) == 5


def test_a_crooked_line_comes_to_the_axis() -> None:
    line_mm = straight(40.0)
    crooked_mm = line_mm + np.random.default_rng(0).uniform(-0.6, 0.6, line_mm.shape)
    found_mm = refine(crooked_mm, walls_of(line_mm, 4.0), 0.8, 4.0)
    way = (line_mm[-1] - line_mm[0]) / 40
    beside_mm = np.linalg.norm(np.cross(found_mm - line_mm[0], way), axis=1)
    assert beside_mm.mean() < 0.04
    # The first and the last point started up to a millimetre off and weigh little.
    assert beside_mm[3:-3].max() < 0.1


def test_smoothing_does_not_cut_bends() -> None:
    line_mm = helix(8.0, 20.0, 1.0, 400)
    found_mm = refine(line_mm, walls_of(line_mm[::2], 3.0), 0.6, 3.0)
    assert np.abs(np.hypot(found_mm[:, 0], found_mm[:, 1]) - 8.0).mean() < 0.02 * 3.0
    assert cKDTree(line_mm).query(found_mm)[0].max() < 0.1
