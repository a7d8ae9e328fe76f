"""Which poses a cone holds."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.errors import InputError
from registration.rigid.search_cone import Bound, SearchCone

CENTRE = np.array([100.0, -40, 7])
INITIAL = transforms.from_rotation(Rotation.from_rotvec([0.4, 2.0, -1.0]), np.array([5.0, 60, -9]))
BOUND = Bound(INITIAL, SearchCone(angle_deg=30.0, radius_mm=10.0), CENTRE)


def changed(angle_deg: float, shift_mm: float) -> np.ndarray:
    """The initial pose, turned about where the cloud's centre comes to lie, then shifted."""
    turn = Rotation.from_rotvec(np.deg2rad(angle_deg) * np.array([1.0, 2, 2]) / 3)
    about = transforms.rotate_about(turn, transforms.apply(INITIAL, CENTRE))
    return transforms.compose(transforms.translation((0.0, shift_mm, 0.0)), about, INITIAL)


@pytest.mark.parametrize(
    "angle_deg, shift_mm, inside",
    [(0, 0, True), (29, 9, True), (31, 0, False), (0, 11, False), (-29, -9, True)],
)
def test_a_pose_is_held_by_its_turn_and_by_its_shift(angle_deg: float, shift_mm: float, inside: bool) -> None:
    assert BOUND.holds(changed(angle_deg, shift_mm)) is inside


@pytest.mark.parametrize("settings", [{"angle_deg": 0.0}, {"angle_deg": 181.0}, {"radius_mm": -1.0}])
def test_settings_out_of_range_are_refused(settings: dict[str, float]) -> None:
    with pytest.raises(InputError, match=f"{next(iter(settings))}: expected"):
        SearchCone(**settings)
