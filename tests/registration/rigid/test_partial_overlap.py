"""Partial overlap: neither cloud holds the other, and the pose that lays all points somewhere near is the wrong one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from vessels import bent_tube

from registration import transforms
from registration.errors import InputError
from registration.geometry.shapes import principal_frame
from registration.metrics.surface_distance import pose_error
from registration.perturbation.perturbation import Piece, draw
from registration.rigid.multi_start import MultiStartICP
from registration.rigid.partial_overlap import BEYOND_LOSS, PartialOverlap, compare_in_view
from registration.rigid.pose_comparison import Evidence
from registration.rigid.result import ACCEPTED
from registration.rigid.search_cone import SearchCone
from registration.rigid.smoothed_target import outward_targets
from registration.rigid.uncertainty import Uncertainty

TUBE = bent_tube()
WHOLE_MM = draw(TUBE, 6000, Piece(), np.random.default_rng(0))
AXIS = principal_frame(WHOLE_MM)
ALONG = (WHOLE_MM - AXIS.centre_mm) @ AXIS.axes[:, 0]
FIRST, LAST = np.quantile(ALONG, [0.36, 0.64])
NOISE = np.random.default_rng(1).normal(scale=0.15, size=WHOLE_MM.shape)
# Each shows 64 % of the vessel, and 28 % of the vessel are in both: 44 % of either.
FIXED_MM = WHOLE_MM[::2][ALONG[::2] < LAST]
MOVING_MM = (WHOLE_MM + NOISE)[1::2][ALONG[1::2] > FIRST]
# The least that tells a result from none: no test here asks for the bootstrap.
METHOD = MultiStartICP(uncertainty=Uncertainty(replicates=20))
ALONE = replace(METHOD, partial_overlap=None)


def guess(angle_deg: float, shift_mm: float, seed: int) -> np.ndarray:
    """A pose so far from the right one, which is the identity."""
    rng = np.random.default_rng(seed)
    axis, way = rng.normal(size=(2, 3))
    turn = Rotation.from_rotvec(np.deg2rad(angle_deg) * axis / np.linalg.norm(axis))
    return transforms.compose(
        transforms.translation(shift_mm * way / np.linalg.norm(way)),
        transforms.rotate_about(turn, MOVING_MM.mean(axis=0)),
    )


def error_mm(pose: np.ndarray) -> float:
    return pose_error(pose, np.eye(4), WHOLE_MM).tre_mm


@pytest.mark.parametrize("seed", range(3))
def test_near_a_known_pose_the_common_part_is_found_but_never_accepted(seed: int) -> None:
    initial = guess(10.0, 5.0, seed)
    try:
        without = error_mm(ALONE(MOVING_MM, FIXED_MM, initial).fixed_T_moving)
    except InputError:
        without = np.inf
    result = METHOD(MOVING_MM, FIXED_MM, initial)
    assert error_mm(result.fixed_T_moving) < 1.0 < without
    assert result.verdict != ACCEPTED


def test_a_part_that_fits_is_ambiguous_and_says_how_large_it_is() -> None:
    result = METHOD(MOVING_MM, FIXED_MM, guess(10.0, 5.0, 0))
    assert result.verdict == "ambiguous"
    assert "found as a partial overlap" in result.reason
    # The part that both show, and a rim around it.
    assert 0.42 < result.overlap_share < 0.6
    assert result.candidates[0].stage == "fine"
    assert np.isfinite([result.coverage, result.rmse_bidirectional_mm]).all()
    assert np.isnan(ALONE(WHOLE_MM[::7], WHOLE_MM[::2], np.eye(4)).overlap_share)


def test_the_gap_is_that_of_the_reason_and_over_all_points() -> None:
    for seed in range(3):
        result = METHOD(MOVING_MM, FIXED_MM, guess(10.0, 5.0, seed))
        if "standard errors" in result.reason:
            assert f"by {abs(result.ambiguity_gap):.1f} standard errors" in result.reason
        else:
            assert result.ambiguity_gap >= METHOD.acceptance.min_gap
        if result.rival_fixed_T_moving is not None:
            assert error_mm(result.rival_fixed_T_moving) > 1.0


def test_the_search_for_a_part_stays_within_the_bound() -> None:
    initial = guess(10.0, 5.0, 0)
    wide, narrow = SearchCone(12.0, 20.0), SearchCone(9.0, 20.0)
    result = METHOD(MOVING_MM, FIXED_MM, initial, search_cone=wide)
    assert error_mm(result.fixed_T_moving) < 1.0
    assert result.search_cone == wide
    with pytest.raises(InputError, match="outside the search cone of 9 degrees"):
        METHOD(MOVING_MM, FIXED_MM, initial, search_cone=narrow)


def test_without_a_known_pose_starts_reach_beyond_the_ends_only_if_asked() -> None:
    moved_mm = transforms.apply(guess(150.0, 60.0, 4), MOVING_MM)
    back = transforms.invert_rigid(guess(150.0, 60.0, 4))

    def error_of(method: MultiStartICP) -> float:
        found = method(moved_mm, FIXED_MM).fixed_T_moving
        return error_mm(transforms.compose(found, transforms.invert_rigid(back)))

    asked = replace(METHOD, partial_overlap=PartialOverlap(overhang=0.6))
    assert error_of(asked) < 1.0
    assert error_of(METHOD) == error_of(ALONE) > 5.0


def test_a_result_that_is_accepted_is_the_same_without_the_search_for_a_part() -> None:
    piece_mm = MOVING_MM[(MOVING_MM - AXIS.centre_mm) @ AXIS.axes[:, 0] < LAST]
    with_it, without = (method(piece_mm, WHOLE_MM[::2], guess(8.0, 4.0, 5)) for method in (METHOD, ALONE))
    assert with_it.verdict == ACCEPTED
    assert np.array_equal(with_it.fixed_T_moving, without.fixed_T_moving)


def test_points_beyond_the_ends_cost_the_same_and_those_across_are_outliers() -> None:
    # A flat square of spacing 1; a point on it, one beyond its edge in its plane, and two above it.
    x, y = np.meshgrid(np.arange(21.0), np.arange(21.0))
    fixed_mm = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    on = fixed_mm[::7] + np.array([0.3, 0.2, 0.0])
    moving_mm = np.concatenate([on, [[60.0, 10.0, 0.0], [10.0, 10.0, 0.25], [10.0, 10.0, 40.0]]])
    exact, smoothed = outward_targets(fixed_mm, 20, 40)
    evidence = Evidence(moving_mm, np.arange(len(moving_mm)), exact, smoothed, core=len(moving_mm))
    view = compare_in_view(evidence, np.eye(4)[None])
    assert view.seen[0].tolist() == [True] * len(on) + [False, True, True]
    assert view.noise_mm == pytest.approx(0.1)
    assert np.allclose(view.loss[0, : len(on)], 0.0, atol=1e-6)
    assert view.loss[0, len(on) :] == pytest.approx([BEYOND_LOSS, 2.5**2, 9.0])
    # Dearer than a fair pair, or the cloud would slide out; cheaper than an outlier, or it would be pulled in.
    assert 1.0 < BEYOND_LOSS < 9.0


def test_settings_out_of_range_are_refused() -> None:
    for settings in (
        {"keep": 0.0},
        {"overhang": 1.0},
        {"min_share": 1.5},
        {"survivors": 0},
        {"finalists": 0},
    ):
        with pytest.raises(InputError, match=next(iter(settings))):
            PartialOverlap(**settings)
