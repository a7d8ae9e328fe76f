"""What a sweep and a calibration refuse to hold, and what they compute."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sweeps import CALIBRATION, known_sweep

from registration.errors import InputError
from registration.sweep import PosedFrames, ProbeCalibration


def test_pixel_to_end_effector_is_the_product() -> None:
    pixel = np.array([3.0, 5.0, 0.0, 1.0])
    by_hand = CALIBRATION.ee_T_probe @ (CALIBRATION.probe_A_pixel @ pixel)
    np.testing.assert_allclose(CALIBRATION.ee_A_pixel @ pixel, by_hand)


def test_spacing_is_down_then_across() -> None:
    # Columns run along -y, 0.1 mm apart, rows along x, 0.2 mm apart.
    matrix = np.array([[0, 0.2, 0, 0], [-0.1, 0, 0, 0], [0, 0, 0.15, 0], [0, 0, 0, 1.0]])
    calibration = ProbeCalibration(np.eye(4), matrix)
    assert calibration.spacing_mm == pytest.approx((0.2, 0.1))


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("image_times_s", np.full(6, np.nan), "image_times_s: expected finite times"),
        ("pose_times_s", np.arange(28.0) % 27, "received poses out of order"),
        (
            "world_T_ee",
            np.tile(np.diag([1.0, 1, -1, 1]), (28, 1, 1)),
            "world_T_ee: expected a right-handed rotation",
        ),
        ("world_T_ee", np.tile(np.diag([1.0, 1, 1.01, 1]), (28, 1, 1)), "world_T_ee: expected orthonormal"),
    ],
)
def test_a_sweep_that_cannot_be_is_refused(field: str, value: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        replace(known_sweep(), **{field: value})


def test_a_calibration_that_cannot_be_is_refused() -> None:
    with pytest.raises(InputError, match="ee_T_probe: expected orthonormal"):
        ProbeCalibration(CALIBRATION.probe_A_pixel, CALIBRATION.probe_A_pixel)
    with pytest.raises(InputError, match="probe_A_pixel: expected an invertible matrix"):
        ProbeCalibration(np.eye(4), np.diag([0.1, 0.1, 0.0, 1.0]))


def test_what_belongs_to_all_frames_is_not_copied() -> None:
    values = np.arange(12.0).reshape(4, 3)
    poses = np.tile(np.eye(4), (4, 1, 1))
    assert PosedFrames(np.arange(4), poses, {}).select(values) is values
    some = PosedFrames(np.array([0, 2]), poses[:2], {}).select(values)
    np.testing.assert_array_equal(some, [[0, 1, 2], [6, 7, 8]])


def test_a_sweep_is_shown_on_one_screen() -> None:
    shown = repr(known_sweep(frame_count=6, height=8, width=11))
    assert shown.splitlines()[0] == "TrackedSweep(6 frames of 8 x 11 px, 28 poses,"
    assert "frames 0.530 to 1.030 s" in shown
    assert len(shown.splitlines()) == 5
