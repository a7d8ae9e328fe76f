"""Around a known pose: no result of any method lies outside the bound, and one that lies at it says so."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from vessels import bent_tube

from registration import transforms
from registration.errors import InputError
from registration.geometry.shapes import principal_frame
from registration.perturbation.perturbation import Piece, draw
from registration.rigid.comparators import (
    FpfhFastGlobal,
    FpfhFeatures,
    FpfhRansac,
    GeneralisedICP,
    SingleStartICP,
)
from registration.rigid.multi_start import MultiStartICP
from registration.rigid.result import RigidResult
from registration.rigid.search_cone import DEFAULT_BOUND, Bound, SearchBound, SearchCone
from registration.rigid.stages import Stages
from registration.rigid.uncertainty import Uncertainty

TUBE = bent_tube()
FIXED = draw(TUBE, 1500, Piece(), np.random.default_rng(0))
MOVING = draw(TUBE, 600, Piece(0.7, "start"), np.random.default_rng(1))
FEATURES = FpfhFeatures(2.0, 12.0)
FAST = MultiStartICP(stages=Stages(fine_points=600), uncertainty=Uncertainty(replicates=20))
METHODS: dict[str, Callable[..., RigidResult]] = {
    "multistart": FAST,
    "single_icp": SingleStartICP(),
    "single_icp_centred": SingleStartICP(align_centroids=True),
    "single_icp_plane": SingleStartICP(refine_by="plane"),
    "gicp": GeneralisedICP(50.0, 1e-3),
    "fpfh_ransac": FpfhRansac(FEATURES, 3.0, max_iterations=2000),
    "fpfh_fgr": FpfhFastGlobal(FEATURES, 3.0),
}


def guess(seed: int) -> np.ndarray:
    """A pose up to 120 degrees and 60 mm from the right one, which is the identity."""
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    turn = Rotation.from_rotvec(np.deg2rad(rng.uniform(0, 120)) * axis / np.linalg.norm(axis))
    away = rng.normal(size=3)
    shift_mm = rng.uniform(0, 60) * away / np.linalg.norm(away)
    return transforms.compose(
        transforms.translation(shift_mm), transforms.rotate_about(turn, MOVING.mean(axis=0))
    )


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("cone", [None, SearchCone(10.0), SearchCone(radius_mm=5.0)], ids=str)
def test_no_method_goes_farther_from_a_known_pose_than_its_bound(name: str, cone: SearchCone | None) -> None:
    answered = 0
    for seed in range(3):
        initial = guess(seed)
        bound = Bound(initial, cone or SearchCone(), MOVING.mean(axis=0))
        try:
            result = METHODS[name](MOVING, FIXED, initial, search_cone=cone)
        except InputError as refusal:
            # The search everywhere in the cone may end nowhere in it, and says where it ended instead.
            assert name == "multistart"
            assert "search_cone: expected a cone that holds a result" in str(refusal)
            continue
        answered += 1
        assert bound.holds(result.fixed_T_moving), (seed, bound.away(result.fixed_T_moving))
        if bound.at_edge(result.fixed_T_moving):
            assert "border" in result.reason or "at the bound of the search" in result.reason
            assert result.verdict != "accepted" or name == "multistart"
    assert answered or name == "multistart"


def test_the_default_bound_is_the_one_that_is_documented() -> None:
    assert (DEFAULT_BOUND.angle_deg, DEFAULT_BOUND.radius_mm) == (45.0, 20.0)
    assert MultiStartICP().bound == DEFAULT_BOUND


def turned(angle_deg: float, shift_mm: float = 0.0) -> np.ndarray:
    """The right pose, turned about the cloud's middle across the vessel and shifted along it."""
    axes = principal_frame(MOVING).axes
    turn = Rotation.from_rotvec(np.deg2rad(angle_deg) * axes[:, 2])
    return transforms.compose(
        transforms.translation(shift_mm * axes[:, 0]), transforms.rotate_about(turn, MOVING.mean(axis=0))
    )


def test_what_explains_the_clouds_better_beyond_the_bound_is_told() -> None:
    """The right pose is 60 degrees away: nothing within 30 degrees may be accepted."""
    try:
        result = METHODS["multistart"](MOVING, FIXED, turned(60.0), search_cone=SearchCone(30.0, 20.0))
    except InputError as refusal:
        assert "degrees and" in str(refusal)
    else:
        assert result.verdict != "accepted", result.reason
    near = METHODS["multistart"](MOVING, FIXED, turned(25.0, 3.0), search_cone=SearchCone(30.0, 20.0))
    assert near.verdict == "accepted", near.reason
    assert transforms.rotation_angle_deg(near.fixed_T_moving) < 1


def test_an_answer_at_the_bound_says_so() -> None:
    """The right pose is 24.5 of 25 degrees away."""
    result = METHODS["multistart"](MOVING, FIXED, turned(24.5), search_cone=SearchCone(25.0, 20.0))
    assert transforms.rotation_angle_deg(result.fixed_T_moving) < 0.5
    assert "it lies at the bound of the search (24" in result.reason
    assert "of 25 degrees from the initial pose" in result.reason
    single = METHODS["single_icp_plane"](MOVING, FIXED, turned(9.8), search_cone=SearchCone(10.0, 20.0))
    assert single.verdict in ("not judged", "failed")
    assert "bound of the search" in single.reason or "border" in single.reason


def test_a_method_has_a_bound_of_its_own_where_the_cone_leaves_it_open() -> None:
    tight = MultiStartICP(
        stages=Stages(fine_points=600), uncertainty=Uncertainty(replicates=20), bound=SearchBound(10.0, 4.0)
    )
    with pytest.raises(InputError, match="outside the search cone of 10 degrees and 4 mm"):
        tight(MOVING, FIXED, turned(40.0))
    found = tight(MOVING, FIXED, turned(8.0), search_cone=SearchCone(radius_mm=15.0))
    assert Bound(turned(8.0), SearchCone(10.0, 15.0), MOVING.mean(axis=0)).holds(found.fixed_T_moving)


@pytest.mark.parametrize("angle_deg, shift_mm", [(50.0, 0.0), (0.0, 30.0), (170.0, 45.0), (179.9, 1e-9)])
def test_a_pose_is_put_on_the_bound_on_the_way_to_it(angle_deg: float, shift_mm: float) -> None:
    bound = Bound(guess(3), SearchCone(30.0, 10.0), MOVING.mean(axis=0))
    pose = transforms.compose(turned(angle_deg, shift_mm), guess(3))
    held = bound.held(pose)
    transforms.require_rigid(held, "held")
    assert bound.holds(held)
    turn_deg, away_mm = bound.away(held)
    asked_deg, asked_mm = bound.away(pose)
    assert turn_deg == pytest.approx(min(asked_deg, 30.0), abs=1e-4)
    assert away_mm == pytest.approx(min(asked_mm, 10.0), abs=1e-6)
