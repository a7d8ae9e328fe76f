"""Generalised ICP: right within its basin, wrong beyond it, and honest about both."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from turned import FIXED, farthest_mm, moved_by, upside_down

from registration import transforms
from registration.errors import InputError
from registration.rigid.comparators import GeneralisedICP
from registration.rigid.search_cone import SearchCone

METHOD = GeneralisedICP(max_distance_mm=50.0, translation_tolerance_mm=1e-3)


@pytest.mark.parametrize("angle_deg, shift_mm, seed", [(5.0, 2.0, 0), (20.0, 5.0, 1), (30.0, 10.0, 2)])
def test_a_near_pose_is_found(angle_deg: float, shift_mm: float, seed: int) -> None:
    moving, truth = moved_by(angle_deg, shift_mm, seed)
    found = METHOD(moving, FIXED)
    assert farthest_mm(found.fixed_T_moving, truth, moving) < 0.1
    assert found.converged
    assert found.verdict == "not judged"
    assert found.rmse_trimmed_mm < found.rmse_mm < 1.0
    assert found.inlier_share > 0.95
    assert 0 < found.iterations <= METHOD.max_iterations


def test_upside_down_is_beyond_its_basin() -> None:
    moving, truth = upside_down()
    assert farthest_mm(METHOD(moving, FIXED).fixed_T_moving, truth, moving) > 20
    known = transforms.compose(truth, transforms.translation((1.0, -2.0, 1.0)))
    assert farthest_mm(METHOD(moving, FIXED, known).fixed_T_moving, truth, moving) < 0.1


def test_far_from_the_origin_it_is_as_exact() -> None:
    moving, truth = moved_by(20.0, 5.0, 1)
    away = transforms.translation((2e4, -5e4, 1e4))
    found = METHOD(transforms.apply(away, moving), transforms.apply(away, FIXED)).fixed_T_moving
    back = transforms.compose(transforms.invert_rigid(away), found, away)
    assert farthest_mm(back, truth, moving) < 0.1


def test_without_a_pair_in_reach_it_has_not_converged() -> None:
    moving, _ = moved_by(0.0, 400.0)
    found = METHOD(moving, FIXED)
    assert not found.converged
    np.testing.assert_allclose(found.fixed_T_moving, np.eye(4), atol=1e-12)
    assert found.rmse_mm > 300


def test_steps_are_limited_and_the_pose_stays_rigid() -> None:
    moving, _ = moved_by(30.0, 10.0, 2)
    found = dataclasses.replace(METHOD, max_iterations=2)(moving, FIXED)
    assert not found.converged
    rotation = found.fixed_T_moving[:3, :3]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)


def test_it_is_deterministic_and_keeps_to_the_cone() -> None:
    moving, _ = moved_by(20.0, 5.0, 1)
    one, two = (METHOD(moving, FIXED, np.eye(4), search_cone=SearchCone(angle)) for angle in (45.0, 10.0))
    again = METHOD(moving, FIXED, np.eye(4), search_cone=SearchCone(45.0))
    np.testing.assert_array_equal(one.fixed_T_moving, again.fixed_T_moving)
    assert transforms.rotation_angle_deg(two.fixed_T_moving) == pytest.approx(10.0, abs=1e-4)
    assert (one.verdict, two.verdict) == ("not judged", "failed")


@pytest.mark.parametrize(
    "settings",
    [
        {"max_distance_mm": 0.0},
        {"translation_tolerance_mm": -1.0},
        {"rotation_tolerance_deg": 0.0},
        {"neighbours": 4},
        {"max_iterations": 0},
        {"keep": 1.5},
        {"inlier_spacings": 0.0},
    ],
)
def test_settings_out_of_range_are_refused(settings: dict[str, object]) -> None:
    with pytest.raises(InputError, match=f"{next(iter(settings))}: expected"):
        dataclasses.replace(METHOD, **settings)


def test_clouds_and_poses_that_are_none_are_refused() -> None:
    with pytest.raises(InputError, match="moving_mm: expected at least 20 points, received 19"):
        METHOD(FIXED[:19], FIXED)
    with pytest.raises(InputError, match="fixed_mm: expected points that span a surface"):
        METHOD(FIXED, np.zeros((30, 3)))
    with pytest.raises(InputError, match="initial: expected a right-handed"):
        METHOD(FIXED, FIXED, np.diag([1.0, 1, -1, 1]))
