"""Single-start ICP against Open3D's, and what it refuses."""

from __future__ import annotations

import dataclasses

import numpy as np
import open3d
import pytest
from scipy.spatial.transform import Rotation
from vessels import bent_tube

from registration import transforms
from registration.errors import InputError
from registration.geometry.shapes import principal_frame
from registration.rigid.comparators import SingleStartICP
from registration.rigid.search_cone import SearchCone

TUBE = bent_tube()
FIXED = TUBE.sample(2500, np.random.default_rng(0))
MOVING = TUBE.sample(900, np.random.default_rng(1))


def displaced(angle: float, shift_mm: float, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    axis, direction = rng.normal(size=(2, 3))
    turn = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis))
    about = transforms.rotate_about(turn, MOVING.mean(axis=0))
    shift = transforms.translation(shift_mm * direction / np.linalg.norm(direction))
    return transforms.apply(transforms.compose(shift, about), MOVING)


@pytest.mark.parametrize(
    "angle, shift_mm, seed", [(0.2, 3.0, 0), (0.6, 8.0, 1), (2.0, 5.0, 2), (3.0, 10.0, 3)]
)
def test_it_ends_where_open3d_does(angle: float, shift_mm: float, seed: int) -> None:
    """From good starts and from bad ones: in the same optimum or in the same wrong place."""
    moving = displaced(angle, shift_mm, seed)
    found = SingleStartICP(max_iterations=200, tolerance=1e-9)(moving, FIXED)
    source, target = (open3d.geometry.PointCloud(open3d.utility.Vector3dVector(p)) for p in (moving, FIXED))
    reference = open3d.pipelines.registration.registration_icp(
        source,
        target,
        1e6,
        np.eye(4),
        open3d.pipelines.registration.TransformationEstimationPointToPoint(),
        open3d.pipelines.registration.ICPConvergenceCriteria(1e-12, 1e-12, found.iterations),
    )
    apart = transforms.apply(found.fixed_T_moving, moving) - transforms.apply(
        np.array(reference.transformation), moving
    )
    assert np.linalg.norm(apart, axis=1).max() < 1e-3
    assert found.rmse_mm == pytest.approx(reference.inlier_rmse, abs=1e-4)


def test_a_near_start_succeeds_and_one_upside_down_does_not() -> None:
    method = SingleStartICP(max_iterations=200)
    assert method(displaced(0.2, 3.0, 0), FIXED).rmse_mm < 1
    frame = principal_frame(MOVING)
    over = transforms.rotate_about(Rotation.from_rotvec(np.pi * frame.axes[:, 1]), frame.centre_mm)
    moving = transforms.apply(over, MOVING)
    assert method(moving, FIXED).rmse_mm > 1.5
    # From a pose near the truth the same clouds meet.
    known = transforms.compose(transforms.translation((1.0, 2.0, -1.0)), over)
    assert method(moving, FIXED, transforms.invert_rigid(known)).rmse_mm < 1


def test_along_normals_it_settles_where_the_surfaces_meet() -> None:
    """Point to plane slides along the surface where point to point creeps: nearer, in fewer steps."""
    moving = displaced(0.2, 3.0, 0)
    truth = np.linalg.lstsq(np.c_[moving, np.ones(len(moving))], MOVING, rcond=None)[0]
    pose = np.eye(4)
    pose[:3] = truth.T
    plane = SingleStartICP(refine_by="plane")(moving, FIXED)
    point = SingleStartICP(refine_by="point")(moving, FIXED)
    plane_mm, point_mm = (
        np.abs(transforms.apply(found.fixed_T_moving, moving) - transforms.apply(pose, moving)).max()
        for found in (plane, point)
    )
    assert plane_mm < 0.1
    assert plane_mm < point_mm
    assert plane.iterations < point.iterations
    assert plane.converged


def test_along_normals_it_fails_upside_down_too() -> None:
    frame = principal_frame(MOVING)
    over = transforms.rotate_about(Rotation.from_rotvec(np.pi * frame.axes[:, 1]), frame.centre_mm)
    found = SingleStartICP(refine_by="plane")(transforms.apply(over, MOVING), FIXED)
    apart_mm = transforms.apply(transforms.compose(found.fixed_T_moving, over), MOVING) - MOVING
    assert np.linalg.norm(apart_mm, axis=1).max() > 20


def test_a_result_outside_the_cone_has_failed() -> None:
    moving = displaced(0.2, 3.0, 0)
    method = SingleStartICP()
    inside = method(moving, FIXED, np.eye(4), search_cone=SearchCone(30.0, 10.0))
    assert inside.verdict == "not judged"
    outside = method(moving, FIXED, np.eye(4), search_cone=SearchCone(5.0, 10.0))
    assert outside.verdict == "failed"
    assert "outside the search cone of 5 degrees and 10 mm" in outside.reason
    assert transforms.rotation_angle_deg(outside.fixed_T_moving) == pytest.approx(5.0, abs=1e-4)
    assert transforms.rotation_angle_deg(inside.fixed_T_moving) > 5.0
    assert outside.rmse_mm > inside.rmse_mm


def test_centerlines_and_frames_change_nothing() -> None:
    moving = displaced(0.2, 3.0, 0)
    plain = SingleStartICP()(moving, FIXED)
    told = SingleStartICP()(
        moving,
        FIXED,
        moving_centerline_mm=moving[:5],
        fixed_centerline_mm=FIXED[:7],
        moving_frame=np.zeros(len(moving), dtype=np.int64),
    )
    np.testing.assert_array_equal(plain.fixed_T_moving, told.fixed_T_moving)


def test_centroids_are_brought_together_only_when_asked() -> None:
    moving = MOVING + np.array([400.0, 0, 0])
    once = {"max_iterations": 1}
    far = SingleStartICP(**once)(moving, FIXED)
    near = SingleStartICP(**once, align_centroids=True)(moving, FIXED)
    assert near.rmse_mm < 1.5 < far.rmse_mm
    assert not far.converged


def test_centroids_meet_after_a_known_pose_is_applied() -> None:
    turn = transforms.rotate_about(Rotation.from_rotvec([0.3, 2.5, 0.4]), MOVING.mean(axis=0))
    moving = transforms.apply(turn, MOVING) + np.array([0.0, 300.0, 0])
    method = SingleStartICP(align_centroids=True, max_iterations=1)
    far = SearchCone(180.0, 1000.0)
    assert method(moving, FIXED, transforms.invert_rigid(turn), search_cone=far).rmse_mm < 1.5
    assert method(moving, FIXED, transforms.invert_rigid(turn)).verdict == "failed"


def test_the_result_says_what_was_done() -> None:
    found = SingleStartICP(max_iterations=7, tolerance=1e-12)(displaced(0.6, 8.0, 1), FIXED)
    assert (found.iterations, found.converged) == (7, False)
    assert len(found.candidates) == 1
    np.testing.assert_array_equal(found.candidates[0].fixed_T_moving, found.fixed_T_moving)
    assert found.rmse_trimmed_mm == found.rmse_mm
    assert 0 < found.inlier_share <= 1
    assert found.runtime_s > 0


@pytest.mark.parametrize(
    "settings",
    [
        {"keep": 0.0},
        {"max_iterations": 0},
        {"tolerance": -1.0},
        {"inlier_spacings": 0.0},
        {"refine_by": "line"},
        {"neighbours": 2},
    ],
)
def test_settings_out_of_range_are_refused(settings: dict[str, object]) -> None:
    with pytest.raises(InputError, match=f"{next(iter(settings))}: expected"):
        dataclasses.replace(SingleStartICP(), **settings)


def test_clouds_and_poses_that_are_none_are_refused() -> None:
    method = SingleStartICP()
    with pytest.raises(InputError, match="moving_mm: expected at least 3 points"):
        method(np.empty((0, 3)), FIXED)
    with pytest.raises(InputError, match="fixed_mm: expected points that span a surface"):
        method(MOVING, np.zeros((9, 3)))
    with pytest.raises(InputError, match="initial: expected a right-handed"):
        method(MOVING, FIXED, np.diag([1.0, 1, -1, 1]))
