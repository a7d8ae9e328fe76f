"""KISS-Matcher where it is installed, and the sentence that says how to install it where it is not."""

from __future__ import annotations

import dataclasses
import importlib.util
import sys

import numpy as np
import pytest
from turned import FIXED, farthest_mm, moved_by, upside_down

from registration import transforms
from registration.errors import InputError
from registration.rigid.comparators import KissMatcher

METHOD = KissMatcher(voxel_mm=1.5)


if importlib.util.find_spec("kiss_matcher") is not None:

    @pytest.mark.parametrize("far", [False, True])
    def test_the_pose_is_found_from_anywhere(far: bool) -> None:
        moving, truth = moved_by(110.0, 5000.0, 3) if far else upside_down()
        found = METHOD(moving, FIXED)
        assert farthest_mm(found.fixed_T_moving, truth, moving) < 0.1
        np.testing.assert_array_equal(found.fixed_T_moving, METHOD(moving, FIXED).fixed_T_moving)

    def test_clouds_that_match_nowhere_are_refused_or_left_to_the_known_pose() -> None:
        moving, truth = moved_by(60.0, 10.0)
        coarse = KissMatcher(voxel_mm=8.0)
        with pytest.raises(InputError, match="received none that agree on one pose"):
            coarse(moving, FIXED)
        assert farthest_mm(coarse(moving, FIXED, truth).fixed_T_moving, truth, moving) < 0.1


def test_a_package_that_is_not_there_is_asked_for_with_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "kiss_matcher", None)
    with pytest.raises(InputError, match="install it with: pip install kiss-matcher") as refusal:
        METHOD(FIXED, FIXED)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    "settings",
    [
        {"voxel_mm": 0.0},
        {"normal_voxels": 0.0},
        {"feature_voxels": 2.0},
        {"max_matches": 2},
    ],
)
def test_settings_out_of_range_are_refused(settings: dict[str, float]) -> None:
    with pytest.raises(InputError, match=f"{next(iter(settings))}: expected"):
        dataclasses.replace(METHOD, **settings)


def test_clouds_and_poses_that_are_none_are_refused() -> None:
    with pytest.raises(InputError, match="moving_mm: expected at least 3 points"):
        METHOD(np.empty((0, 3)), FIXED)
    with pytest.raises(InputError, match="initial: expected a right-handed"):
        METHOD(FIXED, FIXED, transforms.compose(np.eye(4), np.diag([1.0, 1, -1, 1])))
