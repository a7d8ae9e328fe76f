"""Roll and slide of errors that were put together from known parts."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.errors import InputError
from registration.metrics.pose_error import vessel_error

AXIS = np.array([2.0, 3.0, 6.0]) / 7
ACROSS = np.array([3.0, -2.0, 0.0]) / np.sqrt(13)
TARGETS = np.array([[10.0, 4, 2], [30.0, -4, 2], [20.0, 3, 8], [22.0, 1, -3]])
TRUTH = transforms.from_rotation(Rotation.from_rotvec([0.3, -1.2, 0.5]), np.array([5.0, 60, -20]))


def off(turn: Rotation, shift_mm: np.ndarray) -> np.ndarray:
    """An answer that is wrong by a rotation about the targets' centroid and a shift."""
    error = transforms.compose(
        transforms.translation(shift_mm), transforms.rotate_about(turn, TARGETS.mean(axis=0))
    )
    return transforms.compose(error, TRUTH)


@pytest.mark.parametrize("roll_deg, slide_mm, across_mm", [(0, 0, 0), (35, 7, 4), (-120, -3, 0), (180, 0, 9)])
def test_roll_and_slide_are_told_from_the_rest(roll_deg: float, slide_mm: float, across_mm: float) -> None:
    answer = off(Rotation.from_rotvec(np.deg2rad(roll_deg) * AXIS), slide_mm * AXIS + across_mm * ACROSS)
    found = vessel_error(answer, TRUTH, 5 * AXIS, TARGETS)
    assert found.roll_error_deg == pytest.approx(abs(roll_deg), abs=1e-5)
    assert found.slide_error_mm == pytest.approx(abs(slide_mm), abs=1e-9)


def test_a_tilt_is_no_roll_and_does_not_hide_one() -> None:
    tilt = Rotation.from_rotvec(0.7 * ACROSS)
    assert vessel_error(off(tilt, np.zeros(3)), TRUTH, AXIS, TARGETS).roll_error_deg == pytest.approx(
        0, abs=1e-5
    )
    both = tilt * Rotation.from_rotvec(np.deg2rad(50) * AXIS)
    assert vessel_error(off(both, np.zeros(3)), TRUTH, AXIS, TARGETS).roll_error_deg == pytest.approx(50)


def test_what_can_t_be_measured_is_refused() -> None:
    with pytest.raises(InputError, match="axis: expected a direction"):
        vessel_error(TRUTH, TRUTH, np.zeros(3), TARGETS)
    with pytest.raises(InputError, match="targets_mm: expected finite targets, received 0"):
        vessel_error(TRUTH, TRUTH, AXIS, np.empty((0, 3)))
    with pytest.raises(InputError, match=r"^fixed_T_moving: expected"):
        vessel_error(2 * TRUTH, TRUTH, AXIS, TARGETS)
    with pytest.raises(InputError, match=r"^true_fixed_T_moving: expected"):
        vessel_error(TRUTH, 2 * TRUTH, AXIS, TARGETS)
