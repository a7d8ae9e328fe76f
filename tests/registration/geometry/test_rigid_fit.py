"""The closed-form rigid fit held against scipy and results known by construction."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.geometry.rigid_fit import kabsch


def pose(rotation_vector: list[float], translation_mm: list[float]) -> np.ndarray:
    return transforms.from_rotation(
        Rotation.from_rotvec(rotation_vector), np.array(translation_mm, dtype=float)
    )


def test_kabsch_is_scipys_alignment() -> None:
    rng = np.random.default_rng(5)
    moving, weights = rng.normal(size=(30, 3)) * [5, 2, 1] + 40, rng.uniform(0.1, 2, 30)
    fixed = transforms.apply(pose([0.4, -1.9, 2.0], [3, -80, 9]), moving) + rng.normal(
        scale=0.3, size=(30, 3)
    )
    found = kabsch(moving, fixed, weights)
    moving_centre, fixed_centre = (np.average(points, axis=0, weights=weights) for points in (moving, fixed))
    expected, _ = Rotation.align_vectors(fixed - fixed_centre, moving - moving_centre, weights=weights)
    np.testing.assert_allclose(found[:3, :3], expected.as_matrix(), atol=1e-10)
    np.testing.assert_allclose(transforms.apply(found, moving_centre), fixed_centre)


def test_kabsch_of_many_is_kabsch_of_each_and_weights_leave_points_out() -> None:
    truths = np.stack([pose([0.2, 0.1, 3.0], [1, 2, 3]), pose([-2.0, 0.5, 0], [-40, 0, 5])])
    moving = np.random.default_rng(6).normal(size=(2, 12, 3)) * 10
    fixed = np.stack([transforms.apply(truth, points) for truth, points in zip(truths, moving, strict=True)])
    fixed[:, 0] += 500
    weights = np.ones((2, 12))
    weights[:, 0] = 0
    np.testing.assert_allclose(kabsch(moving, fixed, weights), truths, atol=1e-10)


def test_kabsch_never_mirrors() -> None:
    moving = np.random.default_rng(7).normal(size=(20, 3)) * [5, 4, 3]
    found = kabsch(moving, moving * [1, 1, -1], np.ones(20))
    assert np.linalg.det(found[:3, :3]) == pytest.approx(1)


def test_without_weights_all_pairs_count_alike() -> None:
    rng = np.random.default_rng(8)
    moving, fixed = rng.normal(size=(2, 9, 3)) * 20
    np.testing.assert_allclose(kabsch(moving, fixed), kabsch(moving, fixed, np.full(9, 3.0)), atol=1e-12)


def test_three_pairs_in_a_plane_leave_no_mirror_image() -> None:
    truth = pose([1.0, -2.0, 0.5], [9, -80, 30])
    moving = np.array([[0.0, 0, 0], [40, 0, 0], [10, 25, 0]])
    np.testing.assert_allclose(kabsch(moving, transforms.apply(truth, moving)), truth, atol=1e-10)
