"""Surfaces of labels against the shapes that the voxels were taken from."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import open3d
import pytest
from volumes import OBLIQUE, voxel_axes, voxelised

from registration.ct_model.label_map import LabelMap
from registration.ct_model.label_surface import LabelSurface
from registration.ct_model.vessel_mask import vessel_mask
from registration.errors import InputError
from registration.geometry.mesh_quality import mesh_quality
from registration.geometry.shapes import Mesh
from registration.io.surfaces import read_surface
from registration.metrics.surface_distance import surface_residuals

AXES_MM = np.array([12.0, 7.0, 5.0])
MIDDLE_MM = np.array([40.0, -90.0, 300.0])
SPACINGS_MM = [(0.7, 0.7, 0.7), (0.5, 0.6, 1.5)]
MIRROR = np.diag([1.0, -1.0, 1.0])


def in_ellipsoid(points_mm: np.ndarray) -> np.ndarray:
    return np.asarray((((points_mm - MIDDLE_MM) / AXES_MM) ** 2).sum(axis=1) < 1)


def ring_mm(points_mm: np.ndarray, radius_mm: float, height_mm: float = 0.0) -> np.ndarray:
    """Signed distance to a tube bent to a ring of 20 mm about the z axis."""
    out_mm = np.hypot(points_mm[:, 0], points_mm[:, 1]) - 20
    return np.asarray(np.hypot(out_mm, points_mm[:, 2] - height_mm) - radius_mm)


def sampled(mesh: Mesh) -> np.ndarray:
    return mesh.sample(20_000, np.random.default_rng(0))


@pytest.mark.parametrize("direction", [OBLIQUE, OBLIQUE @ MIRROR], ids=["right-handed", "left-handed"])
@pytest.mark.parametrize("spacing_mm", SPACINGS_MM)
def test_an_oblique_ellipsoid(spacing_mm: tuple[float, ...], direction: np.ndarray) -> None:
    box = (MIDDLE_MM - AXES_MM, MIDDLE_MM + AXES_MM)
    mesh = LabelSurface()(vessel_mask(voxelised(in_ellipsoid, *box, spacing_mm, direction))).mesh
    quality = mesh_quality(mesh)
    assert quality.volume_mm3 == pytest.approx(4 / 3 * np.pi * AXES_MM.prod(), rel=0.01)
    assert quality.watertight and quality.manifold and quality.oriented and quality.pieces == 1
    scaled = (sampled(mesh) - MIDDLE_MM) / AXES_MM
    length = np.linalg.norm(scaled, axis=1)
    # The distance to the ellipsoid to first order: value over slope.
    apart_mm = np.abs(length - 1) * length / np.linalg.norm(scaled / AXES_MM, axis=1)
    assert apart_mm.mean() < min(spacing_mm) / 4
    np.testing.assert_allclose(mesh.vertices_mm.mean(axis=0), MIDDLE_MM, atol=0.15)


@pytest.mark.parametrize("radius_mm", [5.0, 2.5])
@pytest.mark.parametrize("spacing_mm", SPACINGS_MM)
def test_an_oblique_bent_tube(spacing_mm: tuple[float, ...], radius_mm: float) -> None:
    high_mm = np.array([20 + radius_mm, 20 + radius_mm, radius_mm])
    label_map = voxelised(lambda p: ring_mm(p, radius_mm) < 0, -high_mm, high_mm, spacing_mm, OBLIQUE)
    mesh = LabelSurface()(vessel_mask(label_map)).mesh
    assert mesh_quality(mesh).volume_mm3 == pytest.approx(2 * np.pi**2 * 20 * radius_mm**2, rel=0.01)
    apart_mm = ring_mm(sampled(mesh), radius_mm)
    assert np.abs(apart_mm).mean() < min(spacing_mm) / 4
    assert abs(apart_mm.mean()) < 0.01


def test_a_thin_branch_is_not_shrunk_in_favour_of_a_wide_one() -> None:
    def apart_mm(points_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return ring_mm(points_mm, 7.0), ring_mm(points_mm, 2.0, 8.6)

    high_mm = np.array([27.0, 27.0, 10.6])
    inside = voxelised(lambda p: np.minimum(*apart_mm(p)) < 0, -high_mm, high_mm, (0.7, 0.7, 0.7), OBLIQUE)
    wide_mm, thin_mm = apart_mm(sampled(LabelSurface()(vessel_mask(inside)).mesh))
    # Far from where they meet, the top half of the thin one.
    top = np.abs(thin_mm) < np.abs(wide_mm) - 1.0
    assert abs(thin_mm[top].mean()) < 0.05
    assert np.abs(thin_mm[top]).mean() < 0.7 / 4


def test_a_vessel_that_runs_out_of_the_scan_stays_open_at_the_face_of_the_last_voxels() -> None:
    grid = np.stack(np.meshgrid(*[np.arange(count) for count in (21, 21, 30)], indexing="ij"), axis=-1)
    labels = (np.hypot(grid[..., 0] - 10.2, grid[..., 1] - 9.9) < 6.3).astype(np.uint8)
    mask = vessel_mask(LabelMap(labels, voxel_axes((0.5, 0.5, 1.0), np.eye(3), (3.0, 4.0, 5.0)), {}))
    np.testing.assert_array_equal(mask.cut, [[False, False], [False, False], [True, True]])
    mesh = LabelSurface()(mask).mesh
    quality = mesh_quality(mesh)
    assert (quality.open_ends, quality.holes, quality.oriented, quality.pieces) == (2, 0, True, 1)
    np.testing.assert_allclose(mesh.vertices_mm[:, 2].min(), 5.0 - 0.5, atol=1e-5)
    np.testing.assert_allclose(mesh.vertices_mm[:, 2].max(), 5.0 + 29.5, atol=1e-5)
    # Every slice has the same voxels here, so the count of one is off for all: 127 for 124.7.
    assert quality.volume_mm3 == pytest.approx(127 * 0.25 * 30, rel=0.002)
    radius_mm = np.hypot(mesh.vertices_mm[:, 0] - 3 - 5.1, mesh.vertices_mm[:, 1] - 4 - 4.95)
    np.testing.assert_allclose(radius_mm, 3.15, atol=0.2)


def test_the_smallest_labels() -> None:
    labels = np.zeros((8, 8, 8), dtype=np.uint8)
    labels[2, 2, 2] = 1
    with pytest.raises(
        InputError, match="expected a vessel several voxels wide, received 1 voxels of label 1 that no"
    ):
        LabelSurface()(vessel_mask(LabelMap(labels, np.eye(4), {})))
    labels[2:5, 2:5, 2:5] = 1
    small = LabelSurface()(vessel_mask(LabelMap(labels, np.eye(4), {})))
    assert mesh_quality(small.mesh).volume_mm3 == pytest.approx(27.0, rel=0.02)


def test_a_branch_too_thin_for_its_voxels_is_told_by_how_far_it_reached() -> None:
    labels = np.zeros((40, 14, 14), dtype=np.uint8)
    labels[2:12, 2:12, 2:12] = 1
    block = LabelSurface()(vessel_mask(LabelMap(labels, np.eye(4), {})))
    assert block.lost_mm < 2.0
    labels[12:38, 7, 7] = 1
    thin = LabelSurface()(vessel_mask(LabelMap(labels, np.diag([0.5, 0.5, 0.5, 1.0]), {})))
    # 26 voxels of half a millimetre, but for the first of them.
    assert 11.0 < thin.lost_mm <= 13.0
    assert thin.mesh.vertices_mm[:, 0].max() < 8.0


def test_a_volume_without_an_outside_is_refused() -> None:
    with pytest.raises(
        InputError, match="label: expected a vessel several voxels wide, received 125 voxels of label 1"
    ):
        LabelSurface()(vessel_mask(LabelMap(np.ones((5, 5, 5), dtype=np.uint8), np.eye(4), {})))


@pytest.mark.parametrize("value", [0.0, -1.0, 6.0, float("nan")])
def test_settings_are_checked(value: float) -> None:
    with pytest.raises(InputError, match="smoothing_voxels"):
        LabelSurface(smoothing_voxels=value)


@pytest.mark.parametrize("spacing_mm, tolerance_mm", [((0.8, 0.8, 0.8), 0.08), ((0.7, 0.7, 2.5), 0.12)])
def test_the_real_aorta_comes_back(
    real_data: Path, spacing_mm: tuple[float, ...], tolerance_mm: float
) -> None:
    aorta = read_surface(real_data / "vmtk" / "aorta-surface.stl")
    assert isinstance(aorta, Mesh)
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        open3d.core.Tensor(aorta.vertices_mm.astype(np.float32)),
        open3d.core.Tensor(aorta.triangles.astype(np.uint32)),
    )

    def inside(points_mm: np.ndarray) -> np.ndarray:
        points = open3d.core.Tensor(points_mm.astype(np.float32))
        return np.asarray(scene.compute_occupancy(points, nsamples=3).numpy() > 0)

    box = (aorta.vertices_mm.min(axis=0), aorta.vertices_mm.max(axis=0))
    mesh = LabelSurface()(vessel_mask(voxelised(inside, *box, spacing_mm, OBLIQUE))).mesh
    apart = surface_residuals(mesh, aorta, np.eye(4), inlier_mm=1.0, keep=1.0)
    assert apart.msd_mm < tolerance_mm
    assert apart.hd95_mm < min(spacing_mm) / 2
    quality = mesh_quality(mesh)
    assert quality.volume_mm3 == pytest.approx(13184, rel=0.01)
    assert quality.watertight and quality.manifold and quality.oriented
