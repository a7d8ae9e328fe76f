"""Vessels with a known deformation: targets lie inside, and what no sweep sees is told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from registration.benchmark.known_vessels import KnownVessel, known_vessel
from registration.errors import InputError
from registration.geometry.open3d_bridge import TriangleScene
from registration.geometry.shapes import Centerline, Mesh, Polyline


def tube() -> KnownVessel:
    """A straight tube of 5 mm radius, 60 mm long, with flat caps 3 mm beyond the ends of its centerline."""
    turns, heights = np.linspace(0, 2 * np.pi, 24, endpoint=False), np.linspace(-33, 33, 34)
    rings_mm = np.stack([5 * np.cos(turns), 5 * np.sin(turns)], axis=1)
    vertices_mm = np.concatenate([np.column_stack([rings_mm, np.full(24, z)]) for z in heights])
    vertices_mm = np.concatenate([vertices_mm, [[0, 0, -33.0], [0, 0, 33.0]]])
    triangles = []
    for row in range(33):
        for one in range(24):
            a, b = row * 24 + one, row * 24 + (one + 1) % 24
            triangles += [[a, b, b + 24], [a, b + 24, a + 24]]
    for one in range(24):
        other = (one + 1) % 24
        triangles += [[816, other, one], [817, 33 * 24 + one, 33 * 24 + other]]
    line = Polyline(np.column_stack([np.zeros((61, 2)), np.arange(-30.0, 31.0)]), np.full(61, 5.0))
    return KnownVessel("tube", Mesh(vertices_mm, np.array(triangles)), Centerline((line,)))


def test_targets_lie_on_the_line_and_half_way_to_the_wall() -> None:
    targets_mm = tube().targets_mm(np.random.default_rng(0))
    away_mm = np.linalg.norm(targets_mm[:, :2], axis=1)
    half = len(targets_mm) // 2
    np.testing.assert_allclose(away_mm[:half], 0.0, atol=1e-9)
    np.testing.assert_allclose(away_mm[half:], 2.5)
    np.testing.assert_allclose(targets_mm[:half, 2], targets_mm[half:, 2])
    np.testing.assert_allclose(np.diff(targets_mm[:half, 2]), np.diff(targets_mm[:2, 2])[0])


def test_what_lies_beyond_an_end_is_not_beside_the_line() -> None:
    points_mm = np.array([[5.0, 0, 0], [5.0, 0, 29.9], [0, 0, 33.0], [3.0, 0, -33.0], [0, 5.0, 31.5]])
    assert tube().beside_line(points_mm).tolist() == [True, True, False, False, False]


def test_the_longest_axis_is_that_of_the_tube() -> None:
    along_mm = tube().along_mm(np.array([[1.0, 2.0, -20.0], [0.0, 0.0, 10.0]]))
    assert abs(along_mm[1] - along_mm[0]) == pytest.approx(30.0, abs=0.1)


def inside(vessel: KnownVessel) -> float:
    """The share of targets on one side of the wall, which may be oriented either way."""
    targets_mm = vessel.targets_mm(np.random.default_rng(0))
    found = TriangleScene(vessel.surface).closest(targets_mm)
    behind = float(((found.offsets_mm * found.normals).sum(axis=1) > 0).mean())
    return max(behind, 1.0 - behind)


def test_targets_of_the_simulators_vessels_lie_inside() -> None:
    for name in ("artery", "random1200"):
        assert inside(known_vessel(name)) > 0.98
    again = known_vessel("random1200")
    np.testing.assert_array_equal(again.surface.vertices_mm, known_vessel("random1200").surface.vertices_mm)


def test_the_real_aorta_holds_its_targets(real_data: Path) -> None:
    assert inside(known_vessel("aorta", real_data / "vmtk")) > 0.95


def test_unknown_vessels_and_missing_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="aorta: expected the folder"):
        known_vessel("aorta")
    with pytest.raises(InputError, match=r"aorta-surface-open-ends\.stl"):
        known_vessel("aorta", tmp_path)
    for name in ("heart", "random", "randomx"):
        with pytest.raises(InputError, match="vessel: expected aorta, artery, vein or random<seed>"):
            known_vessel(name)
