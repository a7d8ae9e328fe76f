"""Closest points, normals and smoothed surfaces held against brute force and shapes known by formula."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.distance import cdist
from vessels import bent_tube

from registration.rigid.icp.correspondence import TreeTarget, VoxelTarget

FIXED = bent_tube().sample(3000, np.random.default_rng(0))


def test_tree_finds_what_brute_force_finds() -> None:
    asked = FIXED[:50] + np.random.default_rng(2).normal(scale=4, size=(50, 3))
    target = TreeTarget(FIXED)
    expected = FIXED[cdist(asked, FIXED).argmin(axis=1)]
    np.testing.assert_array_equal(target.points_mm[target.closest(asked)], expected)


def test_repeated_points_count_once() -> None:
    target = TreeTarget(np.repeat(FIXED[:100], 30, axis=0), neighbours=8)
    assert len(target.points_mm) == 100
    assert target.spacing_mm == TreeTarget(FIXED[:100]).spacing_mm > 0
    np.testing.assert_allclose(np.abs(target.normals), np.abs(TreeTarget(FIXED[:100], neighbours=8).normals))


def test_spacing_of_a_grid() -> None:
    grid = np.stack(np.meshgrid(np.arange(4) * 0.7, np.arange(5) * 1.5, [3.0]), axis=-1).reshape(-1, 3)
    assert TreeTarget(grid).spacing_mm == pytest.approx(0.7)


def test_normals_of_an_oblique_plane_and_of_a_sphere() -> None:
    rng = np.random.default_rng(3)
    normal = np.array([1.0, 2, -2]) / 3
    plane = rng.normal(size=(200, 3)) * 10
    plane -= np.outer(plane @ normal, normal)
    np.testing.assert_allclose(np.abs(TreeTarget(plane, neighbours=10).normals @ normal), 1, atol=1e-9)
    sphere = rng.normal(size=(4000, 3))
    sphere /= np.linalg.norm(sphere, axis=1, keepdims=True)
    target = TreeTarget(10 * sphere + 50, neighbours=12)
    outward = (target.points_mm - 50) / 10
    assert np.abs((target.normals * outward).sum(axis=1)).min() > 0.98


def test_voxels_answer_within_their_diagonal_inside_and_outside_the_grid() -> None:
    target = VoxelTarget(FIXED, cells=40)
    voxel_mm = np.ptp(FIXED, axis=0).max() / 40
    asked = FIXED.mean(axis=0) + np.random.default_rng(4).uniform(-60, 60, size=(2000, 3))
    exact = cdist(asked, FIXED).min(axis=1)
    answered = np.linalg.norm(target.points_mm[target.closest(asked)] - asked, axis=1)
    inside = (np.abs(asked - FIXED.mean(axis=0)) < 0.4 * np.ptp(FIXED, axis=0)).all(axis=1)
    assert inside.sum() > 20
    assert np.abs(answered - exact)[inside].max() < 2 * np.sqrt(3) * voxel_mm
    assert np.abs(answered - exact)[~inside].max() < 30


def test_voxels_take_their_normals_from_the_exact_target() -> None:
    exact = TreeTarget(FIXED, neighbours=12)
    table = VoxelTarget(FIXED, cells=40, exact=exact)
    apart_mm = cdist(table.points_mm, exact.points_mm)
    first, second = np.sort(apart_mm, axis=1)[:, :2].T
    # The mean of two points in a voxel is as near to one as to the other.
    clear = second - first > 1e-6
    assert clear.mean() > 0.7
    expected = exact.normals[apart_mm.argmin(axis=1)]
    np.testing.assert_array_equal(table.normals[clear], expected[clear])
    assert VoxelTarget(FIXED, cells=40).normals is None
    assert VoxelTarget(FIXED, cells=40, exact=TreeTarget(FIXED)).normals is None


def test_distances_are_those_to_the_closest_point() -> None:
    asked = FIXED[:40] + np.random.default_rng(5).normal(scale=4, size=(40, 3))
    np.testing.assert_allclose(TreeTarget(FIXED).distances_mm(asked), cdist(asked, FIXED).min(axis=1))


def test_remembered_neighbours_are_those_that_are_asked_for() -> None:
    plain, remembering = TreeTarget(FIXED, 12), TreeTarget(FIXED, 12, around=20)
    np.testing.assert_array_equal(np.abs(remembering.normals), np.abs(plain.normals))
    for count in (5, 20, 25):
        for one, two in zip(
            plain.patches(plain.points_mm, count),
            remembering.patches(remembering.points_mm, count),
            strict=True,
        ):
            np.testing.assert_array_equal(one, two)
        np.testing.assert_array_equal(remembering.neighbours_of(count), plain.neighbours_of(count))
    np.testing.assert_array_equal(plain.neighbours_of(3)[:, 0], np.arange(len(plain.points_mm)))


def test_normals_are_turned_to_a_given_side() -> None:
    target = TreeTarget(FIXED, 12)
    out = target.points_mm - target.points_mm.mean(axis=0)
    target.face_like(out)
    assert ((target.normals * out).sum(axis=1) >= 0).all()
