"""The result of a method that follows one pose: what is measured, and when it has failed."""

from __future__ import annotations

import time

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.errors import InputError
from registration.rigid.comparators import SingleStartICP
from registration.rigid.comparators.common import refined, single_result
from registration.rigid.icp.correspondence import TreeTarget
from registration.rigid.result import RigidResult
from registration.rigid.search_cone import SearchCone, known_pose

# The corners of a box.
BOX = np.array([[x, y, z] for x in (0.0, 40.0) for y in (0.0, 20.0) for z in (0.0, 10.0)])


def result_of(
    pose: np.ndarray, cone: SearchCone | None = None, initial: np.ndarray | None = None
) -> RigidResult:
    return single_result(
        BOX,
        TreeTarget(BOX),
        pose,
        start=np.eye(4),
        keep=0.5,
        inlier_spacings=0.3,
        iterations=7,
        converged=True,
        initial=initial,
        search_cone=cone,
        begin_s=time.perf_counter(),
    )


def test_residuals_are_those_of_the_pose() -> None:
    """The box is moved by 2 mm along its longest edge: every corner is 2 mm from its own, within 0.3 * 10 mm."""
    found = result_of(transforms.translation((2.0, 0.0, 0.0)))
    assert found.rmse_mm == pytest.approx(2.0)
    assert found.rmse_trimmed_mm == pytest.approx(2.0)
    assert found.inlier_share == 1.0
    assert (found.iterations, found.converged, found.verdict) == (7, True, "not judged")
    assert result_of(transforms.translation((4.0, 0.0, 0.0))).inlier_share == 0.0


@pytest.mark.parametrize(
    "angle_deg, shift_mm, verdict",
    [(9.0, 0.0, "not judged"), (11.0, 0.0, "failed"), (0.0, 4.7, "not judged"), (0.0, 5.1, "failed")],
)
def test_the_cone_bounds_the_turn_and_the_way_of_the_centroid(
    angle_deg: float, shift_mm: float, verdict: str
) -> None:
    """Turned about its centroid the cloud's centre stays, however far the origin moves."""
    known = transforms.translation((100.0, -30.0, 5.0))
    turn = transforms.rotate_about(Rotation.from_euler("z", angle_deg, degrees=True), BOX.mean(axis=0))
    pose = transforms.compose(known, transforms.translation((0.0, shift_mm, 0.0)), turn)
    found = result_of(pose, SearchCone(10.0, 5.0), known)
    assert found.verdict == verdict
    assert result_of(pose, None, known).verdict == "not judged"


def test_both_ways_are_measured_where_the_clouds_lie_beside_each_other() -> None:
    """Half the box on the whole one: 0 mm there, and back 0 mm from the half that is covered."""
    half = BOX[BOX[:, 0] == 0.0]
    found = single_result(
        half,
        TreeTarget(BOX),
        np.eye(4),
        start=np.eye(4),
        keep=1.0,
        inlier_spacings=0.3,
        iterations=0,
        converged=True,
        initial=None,
        search_cone=None,
        begin_s=time.perf_counter(),
    )
    assert (found.rmse_mm, found.rmse_bidirectional_mm, found.coverage) == (0.0, 0.0, 0.5)
    assert found.candidates[0].coverage == 0.5


def test_a_cone_around_nothing_is_refused() -> None:
    with pytest.raises(InputError, match="search_cone: expected an initial pose to search around"):
        known_pose(None, SearchCone())
    assert known_pose(None, None) is None
    np.testing.assert_array_equal(known_pose(np.eye(4), SearchCone()), np.eye(4))


def test_with_nothing_to_refine_nothing_is_made_up() -> None:
    with pytest.raises(InputError, match="received none that agree on one pose"):
        refined(None, SingleStartICP(), BOX, BOX, None, None, time.perf_counter())


def test_the_better_of_two_refinements_wins_and_both_are_kept() -> None:
    far, near = transforms.translation((30.0, 0.0, 0.0)), transforms.translation((1.0, 0.0, 0.0))
    once = SingleStartICP(max_iterations=1)
    found = refined(far, once, BOX, BOX, near, None, time.perf_counter())
    assert found.rmse_mm < 1e-9
    assert len(found.candidates) == 2
    np.testing.assert_array_equal(found.candidates[0].start_fixed_T_moving, near)
    assert found.iterations == 2
