"""A longer moving cloud: registered the other way, and the result inverted."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from vessels import bent_tube

from registration import transforms
from registration.metrics.surface_distance import pose_error
from registration.perturbation.perturbation import Piece, draw
from registration.rigid.multi_start import MultiStartICP
from registration.rigid.result import RigidResult
from registration.rigid.swapped import is_longer

TUBE = bent_tube()
POSE = transforms.from_rotation(Rotation.from_rotvec([1.9, -0.8, 1.1]), np.array([40.0, -70, 25]))


def cloud(piece: Piece, seed: int, count: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return draw(TUBE, count, piece, rng) + rng.normal(scale=0.2, size=(count, 3))


@pytest.fixture(scope="module")
def found() -> RigidResult:
    """The whole vessel onto half of it, as when CT was cropped: POSE takes moving to fixed."""
    moving = transforms.apply(transforms.invert_rigid(POSE), cloud(Piece(), 0, 2400))
    return MultiStartICP()(moving, cloud(Piece(0.5, "end"), 1, 2000), moving_frame=np.arange(2400))


def test_the_whole_is_laid_on_a_part(found: RigidResult) -> None:
    assert pose_error(found.fixed_T_moving, POSE, TUBE.vertices_mm).tre_mm < 0.5
    assert found.verdict == "accepted", found.reason
    np.testing.assert_array_equal(found.candidates[0].fixed_T_moving, found.fixed_T_moving)
    transforms.require_rigid(found.candidates[0].start_fixed_T_moving, "start")


def test_residuals_are_those_of_the_moving_cloud(found: RigidResult) -> None:
    """Half of the moving points lie on no fixed one, and nearly all fixed ones are covered."""
    assert 0.4 < found.inlier_share < 0.65
    assert found.coverage > 0.9
    assert 5 < found.rmse_bidirectional_mm < found.rmse_mm
    assert abs(found.wall_offset_mm) < 0.1


def test_the_samples_are_motions_in_the_fixed_frame(found: RigidResult) -> None:
    """About the vessel, where the fixed cloud lies, they are small; far away they would be large."""
    low_mm, high_mm = found.tre_interval_mm(TUBE.vertices_mm)
    assert 0 < low_mm < high_mm < 1
    assert low_mm <= pose_error(found.fixed_T_moving, POSE, TUBE.vertices_mm).tre_mm <= 2 * high_mm


def test_a_wall_outside_is_outside_from_both_sides() -> None:
    whole, part = cloud(Piece(), 0, 2400), cloud(Piece(0.5, "end"), 1, 2000)
    middle = TUBE.vertices_mm[:-2].reshape(-1, 32, 3).mean(axis=1)
    nearest = np.linalg.norm(whole[:, None] - middle, axis=2).argmin(axis=1)
    out = whole - middle[nearest]
    wide = whole + 0.4 * out / np.linalg.norm(out, axis=1, keepdims=True)
    assert MultiStartICP()(wide, part).wall_offset_mm == pytest.approx(0.4, abs=0.12)
    assert MultiStartICP()(part, wide).wall_offset_mm == pytest.approx(-0.4, abs=0.12)


def test_isolated_points_make_no_cloud_longer() -> None:
    rng = np.random.default_rng(3)
    whole = cloud(Piece(), 0, 2000)
    isolated = rng.uniform(whole.min(axis=0) - 30, whole.max(axis=0) + 30, (200, 3))
    assert not is_longer(np.concatenate([whole, isolated]), cloud(Piece(), 1, 2000))
    assert is_longer(whole, cloud(Piece(0.6, "end"), 1, 2000))
    assert not is_longer(cloud(Piece(0.6, "end"), 1, 2000), whole)
