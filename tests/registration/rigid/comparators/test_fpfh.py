"""Global registration by features: the pose from anywhere, the same one every time, and what is refused."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from turned import FIXED, TUBE, farthest_mm, moved_by, upside_down

from registration import transforms
from registration.errors import InputError
from registration.rigid.comparators import FpfhFastGlobal, FpfhFeatures, FpfhRansac
from registration.rigid.search_cone import SearchCone

FEATURES = FpfhFeatures(voxel_mm=2.0, radius_mm=12.0)
RANSAC = FpfhRansac(FEATURES, max_distance_mm=3.0)
FAST = FpfhFastGlobal(FEATURES, max_distance_mm=3.0)
METHODS = pytest.mark.parametrize("method", [RANSAC, FAST], ids=["ransac", "fgr"])


@METHODS
def test_the_pose_is_found_from_upside_down_where_single_starts_fail(
    method: FpfhRansac | FpfhFastGlobal,
) -> None:
    moving, truth = upside_down()
    assert farthest_mm(method.refine(moving, FIXED).fixed_T_moving, truth, moving) > 20
    found = method(moving, FIXED)
    assert farthest_mm(found.fixed_T_moving, truth, moving) < 0.1
    assert found.converged
    assert found.verdict == "not judged"
    assert len(found.candidates) == 1


@METHODS
def test_a_pose_far_away_is_found(method: FpfhRansac | FpfhFastGlobal) -> None:
    moving, truth = moved_by(110.0, 5000.0, 3)
    assert farthest_mm(method(moving, FIXED).fixed_T_moving, truth, moving) < 0.1


@METHODS
def test_the_same_seed_gives_the_same_result_whatever_ran_before(method: FpfhRansac | FpfhFastGlobal) -> None:
    noise = 0.4 * np.random.default_rng(5).normal(size=FIXED.shape)
    moving = moved_by(90.0, 30.0, 2)[0]
    features = [FEATURES(cloud - cloud.mean(axis=0), "cloud") for cloud in (moving, FIXED + noise)]

    def result_of(seed: int) -> bytes:
        chosen = dataclasses.replace(method, seed=seed)
        if isinstance(chosen, FpfhRansac):
            # So few draws that the best of them depends on which were drawn.
            chosen = dataclasses.replace(chosen, max_iterations=50)
        else:
            chosen = dataclasses.replace(chosen, max_triples=60)
        return np.array(chosen.search(*features).transformation).tobytes()

    first = result_of(1)
    others = {result_of(seed) for seed in range(8)}
    assert len(others) > 1
    assert result_of(1) == first


@METHODS
def test_a_known_pose_is_refined_beside_what_is_found(method: FpfhRansac | FpfhFastGlobal) -> None:
    moving, truth = upside_down()
    near = transforms.compose(truth, transforms.translation((1.0, -1.0, 2.0)))
    found = method(moving, FIXED, near)
    assert farthest_mm(found.fixed_T_moving, truth, moving) < 0.1
    assert [candidate.basin for candidate in found.candidates] == [0, 1]
    assert found.candidates[0].rmse_mm <= found.candidates[1].rmse_mm


def test_what_lies_outside_the_cone_cannot_win() -> None:
    """Where ICP ends upside down is taken as known, and the search may not turn from it: that is all that is left."""
    moving, truth = upside_down()
    wrong = RANSAC.refine(moving, FIXED).fixed_T_moving
    found = RANSAC(moving, FIXED, wrong, search_cone=SearchCone(20.0, 10.0))
    assert farthest_mm(found.fixed_T_moving, truth, moving) > 20
    assert found.verdict == "not judged"
    assert found.candidates[0].rmse_mm > found.candidates[1].rmse_mm
    # The true pose was found, and is kept among the candidates.
    assert farthest_mm(found.candidates[1].fixed_T_moving, truth, moving) < 0.1
    nowhere = RANSAC(moving, FIXED, np.eye(4), search_cone=SearchCone(1.0, 1.0))
    assert nowhere.verdict == "failed"
    assert "outside the search cone" in nowhere.reason


def test_clouds_without_a_match_are_refused_or_left_to_the_known_pose() -> None:
    tight = dataclasses.replace(RANSAC, max_distance_mm=1e-9, max_iterations=50)
    moving, truth = moved_by(60.0, 10.0)
    with pytest.raises(InputError, match="moving_mm: expected features that match those of fixed_mm"):
        tight(moving, FIXED)
    found = tight(moving, FIXED, truth)
    assert farthest_mm(found.fixed_T_moving, truth, moving) < 0.1


@METHODS
@pytest.mark.parametrize(
    "settings",
    [{"max_distance_mm": 0.0}, {"edge_similarity": 1.2}, {"seed": -1}],
    ids=lambda s: next(iter(s)),
)
def test_settings_out_of_range_are_refused(
    method: FpfhRansac | FpfhFastGlobal, settings: dict[str, object]
) -> None:
    with pytest.raises(InputError, match=f"{next(iter(settings))}: expected"):
        dataclasses.replace(method, **settings)


@pytest.mark.parametrize(
    "method, settings",
    [
        (RANSAC, {"max_iterations": 0}),
        (RANSAC, {"confidence": 0.0}),
        (FAST, {"max_triples": 0}),
        (FAST, {"iterations": 0}),
    ],
)
def test_each_ones_own_settings_are_checked(
    method: FpfhRansac | FpfhFastGlobal, settings: dict[str, object]
) -> None:
    with pytest.raises(InputError, match=f"{next(iter(settings))}: expected"):
        dataclasses.replace(method, **settings)


@METHODS
def test_clouds_and_poses_that_are_none_are_refused(method: FpfhRansac | FpfhFastGlobal) -> None:
    with pytest.raises(InputError, match="moving_mm: expected at least 3 points"):
        method(np.empty((0, 3)), FIXED)
    broken = FIXED.copy()
    broken[4, 0] = np.inf
    with pytest.raises(InputError, match="fixed_mm: expected finite coordinates"):
        method(FIXED, broken)
    with pytest.raises(InputError, match="initial: expected orthonormal"):
        method(FIXED, FIXED, np.diag([1.0, 1, 1.2, 1]))


def test_a_piece_is_found_in_its_place() -> None:
    """The middle 60 % of the tube, from anywhere, with noise."""
    rng = np.random.default_rng(3)
    drawn = TUBE.sample(4000, rng)
    along = (drawn - drawn.mean(axis=0)) @ np.linalg.svd(drawn - drawn.mean(axis=0), full_matrices=False)[2][
        0
    ]
    piece = drawn[np.abs(along - np.median(along)) < 0.3 * np.ptp(along)]
    piece = piece + 0.2 * rng.normal(size=piece.shape)
    pose = moved_by(150.0, 40.0, 6)[1]
    found = RANSAC(transforms.apply(transforms.invert_rigid(pose), piece), FIXED)
    assert (
        farthest_mm(found.fixed_T_moving, pose, transforms.apply(transforms.invert_rigid(pose), piece)) < 1.0
    )
