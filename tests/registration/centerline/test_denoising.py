"""Noisy walls of tubes smoothed, and smooth ones left alone."""

from __future__ import annotations

import numpy as np
import pytest
from tubes import helix, straight, tube

from registration.centerline.denoising import smooth_if_rough
from registration.geometry.shapes import Mesh
from registration.metrics.surface_distance import SurfaceDistance, rms


def noisy(mesh: Mesh, noise_mm: float) -> Mesh:
    rng = np.random.default_rng(1)
    return Mesh(mesh.vertices_mm + rng.normal(0, noise_mm, mesh.vertices_mm.shape), mesh.triangles)


@pytest.mark.parametrize("noise_mm", [0.2, 0.5])
def test_noise_as_large_as_the_triangles_goes(noise_mm: float) -> None:
    exact = tube(helix(), 4.0, around=48)
    rough = noisy(exact, noise_mm)
    smooth = smooth_if_rough(rough, 0.01)
    distance = SurfaceDistance(exact)
    assert rms(distance(smooth.vertices_mm)) < 0.4 * rms(distance(rough.vertices_mm))
    # Folded triangles made the area larger: noise of 0.5 mm by more than half of it.
    assert smooth.areas_mm2.sum() == pytest.approx(exact.areas_mm2.sum(), rel=0.06)
    np.testing.assert_array_equal(smooth.triangles, exact.triangles)


def test_a_smooth_wall_stays_and_so_does_one_whose_roughness_is_allowed() -> None:
    exact = tube(straight(), 4.0)
    assert smooth_if_rough(exact, 0.01) is exact
    rough = noisy(exact, 0.1)
    assert smooth_if_rough(rough, 0.01) is not rough
    assert smooth_if_rough(rough, 0.1) is rough


def test_coarse_triangles_are_no_noise() -> None:
    coarse = tube(straight(40.0, 4.0), 4.0, around=6)
    assert smooth_if_rough(coarse, 0.01) is coarse
    empty = Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))
    assert smooth_if_rough(empty, 0.01) is empty
