"""The parts of ICP held against brute force, scipy and answers known by construction."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation
from vessels import bent_tube

from registration import frames
from registration.errors import InputError
from registration.icp import TreeTarget, VoxelTarget, align, kabsch, plane_step, trimming_weights

TUBE = bent_tube()
FIXED = TUBE.sample(3000, np.random.default_rng(0))
MOVING = TUBE.sample(400, np.random.default_rng(1))
SETTINGS = {"keep": 1.0, "max_iterations": 60, "tolerance": 1e-6}


def pose(rotation_vector: list[float], translation_mm: list[float]) -> np.ndarray:
    return frames.from_rotation(Rotation.from_rotvec(rotation_vector), np.array(translation_mm, dtype=float))


def near(turn: float = 0.1) -> np.ndarray:
    """A small displacement about the cloud's own centre."""
    turned = frames.rotate_about(Rotation.from_rotvec([turn, -turn, turn / 2]), FIXED.mean(axis=0))
    return frames.compose(frames.translation((1.0, -0.5, 0.8)), turned)


def displacement_mm(found: np.ndarray, expected: np.ndarray) -> float:
    return float(np.linalg.norm(frames.apply(found, MOVING) - frames.apply(expected, MOVING), axis=1).max())


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


def test_kabsch_is_scipys_alignment() -> None:
    rng = np.random.default_rng(5)
    moving, weights = rng.normal(size=(30, 3)) * [5, 2, 1] + 40, rng.uniform(0.1, 2, 30)
    fixed = frames.apply(pose([0.4, -1.9, 2.0], [3, -80, 9]), moving) + rng.normal(scale=0.3, size=(30, 3))
    found = kabsch(moving, fixed, weights)
    moving_centre, fixed_centre = (np.average(points, axis=0, weights=weights) for points in (moving, fixed))
    expected, _ = Rotation.align_vectors(fixed - fixed_centre, moving - moving_centre, weights=weights)
    np.testing.assert_allclose(found[:3, :3], expected.as_matrix(), atol=1e-10)
    np.testing.assert_allclose(frames.apply(found, moving_centre), fixed_centre)


def test_kabsch_of_many_is_kabsch_of_each_and_weights_leave_points_out() -> None:
    truths = np.stack([pose([0.2, 0.1, 3.0], [1, 2, 3]), pose([-2.0, 0.5, 0], [-40, 0, 5])])
    moving = np.random.default_rng(6).normal(size=(2, 12, 3)) * 10
    fixed = np.stack([frames.apply(truth, points) for truth, points in zip(truths, moving, strict=True)])
    fixed[:, 0] += 500
    weights = np.ones((2, 12))
    weights[:, 0] = 0
    np.testing.assert_allclose(kabsch(moving, fixed, weights), truths, atol=1e-10)


def test_kabsch_never_mirrors() -> None:
    moving = np.random.default_rng(7).normal(size=(20, 3)) * [5, 4, 3]
    found = kabsch(moving, moving * [1, 1, -1], np.ones(20))
    assert np.linalg.det(found[:3, :3]) == pytest.approx(1)


def test_trimming_keeps_the_closest_share() -> None:
    squared = np.array([[4.0, 1, 9, 16, 0], [1, 2, 3, 4, 5]])
    np.testing.assert_array_equal(trimming_weights(squared, 0.6), [[1, 1, 0, 0, 1], [1, 1, 1, 0, 0]])
    np.testing.assert_array_equal(trimming_weights(squared, 1.0), np.ones((2, 5)))
    # Three pairs at least, or no rotation follows from them.
    np.testing.assert_array_equal(trimming_weights(squared, 0.01).sum(axis=1), [3, 3])


@pytest.mark.parametrize("neighbours, tolerance_mm", [(0, 0.6), (12, 0.05)])
def test_a_small_displacement_is_found_again(neighbours: int, tolerance_mm: float) -> None:
    truth = frames.invert_rigid(near())
    displaced = frames.apply(near(), MOVING)
    found = align(
        displaced, TreeTarget(FIXED, neighbours), np.eye(4)[None], **(SETTINGS | {"max_iterations": 300})
    )
    assert found.converged.all()
    offset = frames.apply(found.fixed_T_moving[0], displaced) - frames.apply(truth, displaced)
    assert np.linalg.norm(offset, axis=1).max() < tolerance_mm


def test_a_step_along_normals_is_newtons_on_a_box_corner() -> None:
    """Three planes at right angles, a pure translation: one step along the normals removes all of it."""
    grid = np.stack(np.meshgrid(np.arange(1.0, 9), np.arange(1.0, 9)), axis=-1).reshape(-1, 2)
    faces = [np.insert(grid, axis, 0.0, axis=1) for axis in range(3)]
    fixed = np.concatenate(faces)
    target = TreeTarget(fixed, neighbours=5)
    target.normals = np.abs(np.round(target.normals, 6))
    moved = (fixed + np.array([0.2, -0.1, 0.3]))[None]
    index = target.closest(moved[0])[None]
    stepped = frames.apply(plane_step(moved, target, index, np.ones(index.shape))[0], moved[0])
    np.testing.assert_allclose(stepped, fixed, atol=1e-6)


def test_a_step_along_normals_leaves_free_directions_alone() -> None:
    """On one plane nothing says where to slide or how to turn within it: only the distance goes."""
    grid = np.stack(np.meshgrid(np.arange(12.0), np.arange(9.0), [0.0]), axis=-1).reshape(-1, 3)
    target = TreeTarget(grid, neighbours=6)
    moved = (grid + np.array([0.3, 0.2, 0.4]))[None]
    step = plane_step(moved, target, target.closest(moved[0])[None], np.ones((1, len(grid))))
    np.testing.assert_allclose(step[0], frames.translation((0.0, 0.0, -0.4)), atol=1e-9)


def test_a_step_along_normals_needs_them() -> None:
    with pytest.raises(InputError, match="target: expected normals"):
        plane_step(
            MOVING[None],
            TreeTarget(FIXED),
            np.zeros((1, len(MOVING)), dtype=np.int64),
            np.ones((1, len(MOVING))),
        )


def test_starts_do_not_disturb_each_other() -> None:
    starts = np.stack([near(), near(-0.3), frames.compose(frames.translation((30.0, 0, 0)), near(2.0))])
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
        moved = frames.apply(found.fixed_T_moving[0], MOVING)
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
    stray = MOVING[:60] + np.array([0.0, 25.0, 0.0])
    spoilt = np.concatenate([MOVING, stray])
    target = TreeTarget(FIXED, neighbours=12)
    trimmed = align(spoilt, target, near()[None], keep=0.8, max_iterations=100, tolerance=1e-6)
    plain = align(spoilt, target, near()[None], keep=1.0, max_iterations=100, tolerance=1e-6)
    assert displacement_mm(trimmed.fixed_T_moving[0], np.eye(4)) < 0.1
    assert displacement_mm(plain.fixed_T_moving[0], np.eye(4)) > 1
