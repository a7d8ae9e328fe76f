"""Pairs of a square and a plane, written down by hand."""

from __future__ import annotations

import numpy as np

from registration import transforms
from registration.rigid.icp.correspondence import TreeTarget
from registration.rigid.icp.pairs import closest_pairs

GRID = np.stack(np.meshgrid(np.arange(6.0), np.arange(6.0), [0.0]), axis=-1).reshape(-1, 3)


def test_pairs_of_two_poses() -> None:
    moving = np.array([[1.0, 1, 0], [2.2, 3, 0]])
    poses = np.stack([transforms.translation((0, 0, 2.0)), transforms.translation((1.0, 0, -1.0))])
    found = closest_pairs(moving, TreeTarget(GRID, neighbours=6), poses, np.array([[0.0, 0, 1], [0, 0, 1]]))
    np.testing.assert_allclose(found.moved_mm[1], [[2, 1, -1], [3.2, 3, -1]])
    np.testing.assert_allclose(found.fixed_mm[0], [[1, 1, 0], [2, 3, 0]])
    np.testing.assert_allclose(found.squared_mm2, [[4, 4.04], [1, 1.04]])
    np.testing.assert_allclose(np.abs(found.gap_mm), [[2, 2], [1, 1]])
    np.testing.assert_allclose(found.moved_normals, np.tile([0.0, 0, 1], (2, 2, 1)))


def test_normals_turn_with_the_cloud_and_may_be_missing() -> None:
    quarter = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    found = closest_pairs(GRID[:1], TreeTarget(GRID), quarter[None], np.array([[0.0, 0, 1]]))
    np.testing.assert_allclose(found.moved_normals, [[[0, -1, 0]]])
    assert found.normals is None
    # Without normals the whole distance is the gap.
    bare = closest_pairs(GRID[:1], TreeTarget(GRID), transforms.translation((0, 0.3, 0.4))[None])
    np.testing.assert_allclose(bare.gap_mm, [[0.5]])
