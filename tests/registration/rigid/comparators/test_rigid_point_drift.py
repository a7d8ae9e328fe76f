"""Rigid Coherent Point Drift: right from a near pose, wrong upside down, and honest about both."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from turned import FIXED, farthest_mm, moved_by, upside_down

from registration import transforms
from registration.errors import InputError
from registration.rigid.comparators import RigidPointDrift
from registration.rigid.search_cone import SearchCone

METHOD = RigidPointDrift()


@pytest.mark.parametrize("angle_deg, shift_mm, seed", [(5.0, 2.0, 0), (20.0, 5.0, 1)])
def test_a_near_pose_is_found(angle_deg: float, shift_mm: float, seed: int) -> None:
    moving, truth = moved_by(angle_deg, shift_mm, seed)
    found = METHOD(moving, FIXED)
    assert farthest_mm(found.fixed_T_moving, truth, moving) < 0.5
    assert found.verdict == "not judged"
    assert 0 < found.iterations <= METHOD.max_iterations


def test_upside_down_is_beyond_its_basin_and_a_known_pose_helps() -> None:
    moving, truth = upside_down()
    assert farthest_mm(METHOD(moving, FIXED).fixed_T_moving, truth, moving) > 20
    known = transforms.compose(truth, transforms.translation((1.0, -2.0, 1.0)))
    assert farthest_mm(METHOD(moving, FIXED, known).fixed_T_moving, truth, moving) < 0.5


def test_far_from_the_origin_it_is_as_exact() -> None:
    moving, truth = moved_by(20.0, 5.0, 1)
    away = transforms.translation((2e4, -5e4, 1e4))
    found = METHOD(transforms.apply(away, moving), transforms.apply(away, FIXED)).fixed_T_moving
    back = transforms.compose(transforms.invert_rigid(away), found, away)
    assert farthest_mm(back, truth, moving) < 0.5


def test_steps_are_limited_the_pose_stays_rigid_and_the_cone_is_kept_to() -> None:
    moving, _ = moved_by(20.0, 5.0, 1)
    found = dataclasses.replace(METHOD, max_iterations=2)(moving, FIXED)
    assert not found.converged
    rotation = found.fixed_T_moving[:3, :3]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
    kept = METHOD(moving, FIXED, np.eye(4), search_cone=SearchCone(10.0))
    assert kept.verdict == "failed"
    assert transforms.rotation_angle_deg(kept.fixed_T_moving) == pytest.approx(10.0, abs=1e-4)


@pytest.mark.parametrize(
    "settings",
    [
        {"outlier_weight": 1.0},
        {"outlier_weight": -0.1},
        {"neighbours": 0},
        {"tolerance": 0.0},
        {"max_iterations": 0},
        {"keep": 1.5},
        {"inlier_spacings": 0.0},
    ],
)
def test_a_setting_out_of_range_is_refused(settings: dict[str, float]) -> None:
    with pytest.raises(InputError, match=next(iter(settings))):
        RigidPointDrift(**settings)  # type: ignore[arg-type]
