"""The loop of ICP held against brute force and results known by construction."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation
from vessels import bent_tube

from registration import transforms
from registration.rigid.icp.correspondence import TreeTarget
from registration.rigid.icp.estimation import Symmetric
from registration.rigid.icp.loop import align
from registration.rigid.icp.rejection import DistanceRejection, NormalRejection
from registration.rigid.icp.robust_kernels import Tukey

TUBE = bent_tube()
FIXED = TUBE.sample(3000, np.random.default_rng(0))
MOVING = TUBE.sample(400, np.random.default_rng(1))
SETTINGS = {"keep": 1.0, "max_iterations": 60, "tolerance": 1e-6}


def pose(rotation_vector: list[float], translation_mm: list[float]) -> np.ndarray:
    return transforms.from_rotation(
        Rotation.from_rotvec(rotation_vector), np.array(translation_mm, dtype=float)
    )


def near(turn: float = 0.1) -> np.ndarray:
    """A small displacement about the cloud's own centre."""
    turned = transforms.rotate_about(Rotation.from_rotvec([turn, -turn, turn / 2]), FIXED.mean(axis=0))
    return transforms.compose(transforms.translation((1.0, -0.5, 0.8)), turned)


def displacement_mm(found: np.ndarray, expected: np.ndarray) -> float:
    return float(
        np.linalg.norm(transforms.apply(found, MOVING) - transforms.apply(expected, MOVING), axis=1).max()
    )


@pytest.mark.parametrize("neighbours, tolerance_mm", [(0, 0.6), (12, 0.05)])
def test_a_small_displacement_is_found_again(neighbours: int, tolerance_mm: float) -> None:
    truth = transforms.invert_rigid(near())
    displaced = transforms.apply(near(), MOVING)
    found = align(
        displaced, TreeTarget(FIXED, neighbours), np.eye(4)[None], **(SETTINGS | {"max_iterations": 300})
    )
    assert found.converged.all()
    offset = transforms.apply(found.fixed_T_moving[0], displaced) - transforms.apply(truth, displaced)
    assert np.linalg.norm(offset, axis=1).max() < tolerance_mm


def test_starts_do_not_disturb_each_other() -> None:
    starts = np.stack(
        [near(), near(-0.3), transforms.compose(transforms.translation((30.0, 0, 0)), near(2.0))]
    )
    target = TreeTarget(FIXED)
    together = align(MOVING, target, starts, **SETTINGS)
    for index in range(3):
        alone = align(MOVING, target, starts[index : index + 1], **SETTINGS)
        np.testing.assert_allclose(together.fixed_T_moving[index], alone.fixed_T_moving[0], atol=1e-9)
        assert together.iterations[index] == alone.iterations[0]
        assert together.rmse_mm[index] == pytest.approx(alone.rmse_mm[0])


def test_the_residual_falls_with_every_step_and_is_that_of_the_pose() -> None:
    start, target, residuals = near(0.4)[None], TreeTarget(FIXED), []
    for steps in range(1, 8):
        found = align(MOVING, target, start, keep=1.0, max_iterations=steps, tolerance=1e-9)
        assert not found.converged.any()
        assert found.iterations.tolist() == [steps]
        residuals.append(float(found.rmse_mm[0]))
        moved = transforms.apply(found.fixed_T_moving[0], MOVING)
        assert residuals[-1] == pytest.approx(np.sqrt((cdist(moved, FIXED).min(axis=1) ** 2).mean()))
    assert (np.diff(residuals) < 0).all()


def test_equal_clouds_meet_and_rest() -> None:
    found = align(FIXED, TreeTarget(FIXED), near(0.02)[None], keep=1.0, max_iterations=200, tolerance=1e-6)
    assert found.converged.all()
    assert found.rmse_mm[0] < 1e-9


def test_two_poses_that_change_places_forever_count_as_settled() -> None:
    """Pairs that alternate between a cloud and a larger one beside it: the residual alternates, the poses too."""

    class Alternating:
        points_mm = np.concatenate([MOVING, 1.2 * MOVING + np.array([2.0, 0, 0])])
        normals = None
        asked = 0

        def closest(self, points_mm: np.ndarray) -> np.ndarray:
            self.asked += 1
            return np.arange(len(points_mm)) + (self.asked % 2) * len(MOVING)

    found = align(MOVING, Alternating(), np.eye(4)[None], keep=1.0, max_iterations=50, tolerance=1e-6)
    assert found.converged.all()
    assert found.iterations[0] < 6


def test_trimming_shuts_out_points_that_belong_nowhere() -> None:
    isolated = MOVING[:60] + np.array([0.0, 25.0, 0.0])
    spoilt = np.concatenate([MOVING, isolated])
    target = TreeTarget(FIXED, neighbours=12)
    trimmed = align(spoilt, target, near()[None], keep=0.8, max_iterations=100, tolerance=1e-6)
    plain = align(spoilt, target, near()[None], keep=1.0, max_iterations=100, tolerance=1e-6)
    assert displacement_mm(trimmed.fixed_T_moving[0], np.eye(4)) < 0.1
    assert displacement_mm(plain.fixed_T_moving[0], np.eye(4)) > 1


def test_a_kernel_or_a_rejection_shuts_outliers_out_as_trimming_does() -> None:
    isolated = MOVING[:60] + np.array([0.0, 25.0, 0.0])
    spoilt = np.concatenate([MOVING, isolated])
    target = TreeTarget(FIXED, neighbours=12)
    more = {"max_iterations": 100, "tolerance": 1e-6}
    for part in ({"kernel": Tukey()}, {"rejections": (DistanceRejection(5.0),)}):
        found = align(spoilt, target, near()[None], **more, **part)
        assert displacement_mm(found.fixed_T_moving[0], np.eye(4)) < 0.1


def test_a_symmetric_step_uses_the_normals_of_both_clouds() -> None:
    target = TreeTarget(FIXED, neighbours=12)
    normals = target.normals_at(MOVING, 12)
    turned = transforms.invert_rigid(near())
    found = align(
        transforms.apply(near(), MOVING),
        target,
        np.eye(4)[None],
        max_iterations=60,
        tolerance=1e-6,
        estimation=Symmetric(),
        rejections=(NormalRejection(60.0),),
        moving_normals=normals @ near()[:3, :3].T,
    )
    moved = transforms.apply(near(), MOVING)
    offset = transforms.apply(found.fixed_T_moving[0], moved) - transforms.apply(turned, moved)
    assert np.linalg.norm(offset, axis=1).max() < 0.05


def test_a_pose_that_would_lose_every_pair_keeps_the_closest() -> None:
    away = transforms.translation((500.0, 0, 0))
    found = align(
        MOVING,
        TreeTarget(FIXED),
        away[None],
        max_iterations=1,
        tolerance=1e-6,
        rejections=(DistanceRejection(1.0),),
    )
    assert np.isfinite(found.fixed_T_moving).all()
    assert found.fixed_T_moving[0, 0, 3] < 500
