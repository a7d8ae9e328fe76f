"""Which poses are one, and which is better, on grids where both can be counted."""

from __future__ import annotations

import numpy as np
import pytest
from vessels import bent_tube

from registration import transforms
from registration.rigid.icp.correspondence import TreeTarget
from registration.rigid.pose_comparison import Evidence, distinct, two_way
from registration.rigid.residual_model.compact_blocks import blocks_of, blocks_of_frames

GRID = np.stack(np.meshgrid(np.arange(20.0), np.arange(20.0), [0.0]), axis=-1).reshape(-1, 3)


def evidence_of(moving_mm: np.ndarray, block: np.ndarray) -> Evidence:
    target = TreeTarget(GRID, neighbours=9)
    return Evidence(moving_mm, block, target, target)


def test_poses_that_move_points_alike_are_one() -> None:
    shifts = [0.0, 5.0, 0.6, 5.5, 1.1]
    poses = np.stack([transforms.translation((shift, 0.0, 0.0)) for shift in shifts])
    groups = distinct(poses, GRID[:10], reach_mm=1.0)
    # The third is near the first; the fifth is near the third and not near the first, which stands for the group.
    assert [group.tolist() for group in groups] == [[0, 2], [1, 3], [4]]


def test_blocks_are_equal_and_compact_whatever_isolated_points_there_are() -> None:
    cloud = np.concatenate(
        [bent_tube().sample(1600, np.random.default_rng(0)), [[900.0, 0, 0], [0, -700.0, 0]]]
    )
    block = blocks_of(cloud, 32)
    counts = np.bincount(block)
    assert len(counts) == 32
    assert counts.max() - counts.min() <= 1
    extent = np.median([np.ptp(cloud[block == place], axis=0).max() for place in range(32)])
    assert extent < 0.3 * np.ptp(cloud[:1600], axis=0).max()
    assert len(np.unique(blocks_of(cloud[:5], 32))) <= 5


def test_blocks_of_frames_are_runs_of_them() -> None:
    frame = np.array([7, 3, 3, 9, 20, 20, 11, 30])
    # Six frames in three blocks: 3 and 7, 9 and 11, 20 and 30.
    np.testing.assert_array_equal(blocks_of_frames(frame, 3), [0, 0, 0, 1, 2, 2, 1, 2])
    np.testing.assert_array_equal(blocks_of_frames(frame, 99), [1, 0, 0, 2, 4, 4, 3, 5])


def test_squared_distances_go_along_the_normal_and_beyond_the_patch() -> None:
    asked = np.array([[3.0, 4, 2], [10.4, 10.3, 0.5], [19 + 3.0 + 4, 5.0, 0]])
    evidence = evidence_of(asked, np.zeros(3, dtype=np.int64))
    squared = evidence.squared_mm2(np.eye(4)[None])[0]
    # The last lies in the plane, 7 mm past the rim, of which 3 spacings are the patch of the rim's points.
    np.testing.assert_allclose(squared, [4, 0.25, 16], atol=1e-9)


def test_a_gap_is_a_difference_over_its_standard_error() -> None:
    """Points at rest and lifted by 2 mm, in four blocks: by hand."""
    rng = np.random.default_rng(1)
    moving = GRID + rng.normal(scale=0.3, size=GRID.shape) * [0, 0, 1]
    block = blocks_of(moving, 4)
    evidence = evidence_of(moving, block)
    poses = np.stack([np.eye(4), transforms.translation((0, 0, 0.5))])
    gap = evidence.gaps(poses)
    usual = 1.4826**2 * np.median(moving[:, 2] ** 2)
    lost = np.minimum((moving[:, 2] + 0.5) ** 2, 9 * usual) - np.minimum(moving[:, 2] ** 2, 9 * usual)
    sums = np.array([lost[block == place].sum() for place in range(4)])
    assert gap[0] == 0
    assert gap[1] == pytest.approx(sums.sum() / np.sqrt(4 * sums.var(ddof=1)))
    assert gap[1] > 5


def test_two_poses_of_a_plane_are_as_good_as_each_other() -> None:
    rng = np.random.default_rng(2)
    moving = GRID[(GRID[:, :2] > 4).all(axis=1) & (GRID[:, :2] < 14).all(axis=1)]
    moving = moving + rng.normal(scale=0.2, size=moving.shape)
    evidence = evidence_of(moving, blocks_of(moving, 16))
    gap = evidence.gaps(np.stack([np.eye(4), transforms.translation((2.0, -1.0, 0))]))
    assert abs(gap[1]) < 2


def test_the_way_back_counts_what_the_moved_cloud_lies_beside() -> None:
    """A quarter of a grid, lifted by 1 mm: covered are its own 100 points and the two rows beside it."""
    quarter = GRID[(GRID[:, 0] < 10) & (GRID[:, 1] < 10)]
    found = two_way(
        TreeTarget(quarter), GRID, transforms.translation((0, 0, 1.0)), 1.0, inlier_mm=1.01, near_mm=1.01
    )
    assert found.coverage == pytest.approx(100 / 400)
    assert found.rmse_bidirectional_mm == pytest.approx(1)
    wider = two_way(
        TreeTarget(quarter), GRID, transforms.translation((0, 0, 1.0)), 1.0, inlier_mm=1.01, near_mm=1.5
    )
    # Twenty points more, each the square root of 2 away.
    assert wider.rmse_bidirectional_mm == pytest.approx(np.sqrt(0.5 * (1 + (100 + 20 * 2) / 120)))
    away = two_way(
        TreeTarget(quarter), GRID, transforms.translation((0, 0, 99.0)), 99.0, inlier_mm=1.0, near_mm=1.0
    )
    assert (away.coverage, away.rmse_bidirectional_mm) == (0.0, float("inf"))
