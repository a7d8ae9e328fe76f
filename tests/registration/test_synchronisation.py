"""Poses at the frames' times, and every reason for which a frame has none."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.errors import InputError
from registration.sweep import ProbeCalibration, TrackedSweep
from registration.synchronisation import (
    AFTER_LAST_POSE,
    BEFORE_FIRST_POSE,
    IN_A_GAP,
    drop_reasons,
    synchronise,
)

CALIBRATION = ProbeCalibration(
    ee_T_probe=transforms.from_rotation(
        Rotation.from_euler("x", 90, degrees=True), np.array([0.0, 0.0, 7.0])
    ),
    probe_A_pixel=np.diag([0.2, 0.3, 0.25, 1.0]),
)


def turning_sweep(image_times_s: list[float], pose_times_s: list[float], **more: object) -> TrackedSweep:
    """The end effector turns about z at 20 degrees and moves along x at 3 mm a second, off the origin."""
    pose_times = np.array(pose_times_s, dtype=np.float64)
    position_mm = np.stack([3 * pose_times + 50, 0 * pose_times - 4, 0 * pose_times + 9], axis=-1)
    world_T_ee = transforms.from_rotation(
        Rotation.from_euler("z", 20 * pose_times[:, None], degrees=True), position_mm
    )
    images = np.zeros((len(image_times_s), 4, 5), dtype=np.uint8)
    return TrackedSweep(
        images, np.array(image_times_s, dtype=np.float64), world_T_ee, pose_times, CALIBRATION, **more
    )


def true_world_A_pixel(time_s: float) -> np.ndarray:
    world_T_ee = transforms.from_rotation(
        Rotation.from_euler("z", 20 * time_s, degrees=True), np.array([3 * time_s + 50, -4.0, 9.0])
    )
    return world_T_ee @ CALIBRATION.ee_T_probe @ CALIBRATION.probe_A_pixel


def test_pose_between_two_poses_is_slerp_and_linear() -> None:
    posed = synchronise(turning_sweep([0.25, 1.0, 2.9], [0.0, 1.0, 2.0, 4.0]), max_gap_s=2.5)
    assert posed.kept.tolist() == [0, 1, 2]
    for world_A_pixel, time_s in zip(posed.world_A_pixel, (0.25, 1.0, 2.9), strict=True):
        np.testing.assert_allclose(world_A_pixel, true_world_A_pixel(time_s), atol=1e-10)


def test_frames_outside_or_in_a_gap_are_dropped_and_counted() -> None:
    sweep = turning_sweep([-0.1, 0.0, 0.5, 1.5, 2.0, 3.0, 3.01, 9.0], [0.0, 1.0, 3.0])
    posed = synchronise(sweep, max_gap_s=1.0)
    assert posed.kept.tolist() == [1, 2, 5]
    assert posed.dropped == {BEFORE_FIRST_POSE: 1, AFTER_LAST_POSE: 2, IN_A_GAP: 2}
    assert drop_reasons(sweep, 1.0).tolist()[:2] == [BEFORE_FIRST_POSE, ""]
    assert len(posed.kept) + sum(posed.dropped.values()) == len(sweep.images)


def test_frame_at_a_pose_beside_a_gap_is_kept() -> None:
    posed = synchronise(turning_sweep([0.0, 5.0, 5.5], [0.0, 5.0, 6.0]), max_gap_s=1.0)
    assert posed.kept.tolist() == [0, 1, 2]
    np.testing.assert_allclose(posed.world_A_pixel[1], true_world_A_pixel(5.0), atol=1e-10)


def test_offset_is_added_to_the_poses_times() -> None:
    # Poses stamped 0.2 s late: the pose stamped t was taken at t - 0.2.
    sweep = turning_sweep([1.0], [0.0, 1.0, 2.0])
    posed = synchronise(sweep, max_gap_s=2.0, offset_s=-0.2)
    np.testing.assert_allclose(posed.world_A_pixel[0], true_world_A_pixel(1.2), atol=1e-10)


def test_counts_of_the_reader_are_carried_over() -> None:
    sweep = turning_sweep([0.5, 7.0], [0.0, 1.0], dropped={"status INVALID": 3, AFTER_LAST_POSE: 1})
    assert synchronise(sweep, 1.0).dropped == {"status INVALID": 3, AFTER_LAST_POSE: 2}


def test_tracker_only_sweep_gives_no_frame() -> None:
    posed = synchronise(turning_sweep([], [0.0, 1.0]), max_gap_s=1.0)
    assert posed.kept.shape == (0,)
    assert posed.world_A_pixel.shape == (0, 4, 4)


@pytest.mark.parametrize("image_times_s", [[-3.0, -1.0], [2.5, 3.0]])
def test_frames_and_poses_that_do_not_overlap_are_refused(image_times_s: list[float]) -> None:
    with pytest.raises(InputError, match=r"overlap in time, received frames from .* poses from 0 to 2 s"):
        synchronise(turning_sweep(image_times_s, [0.0, 2.0]), max_gap_s=5.0)


def test_offset_can_end_the_overlap() -> None:
    with pytest.raises(InputError, match="overlap in time"):
        synchronise(turning_sweep([0.5], [0.0, 1.0]), max_gap_s=5.0, offset_s=0.75)


@pytest.mark.parametrize(
    ("settings", "named"),
    [({"max_gap_s": 0.0}, "max_gap_s"), ({"max_gap_s": 1.0, "offset_s": float("nan")}, "offset_s")],
)
def test_settings_out_of_range_are_refused(settings: dict[str, float], named: str) -> None:
    with pytest.raises(InputError, match=named):
        synchronise(turning_sweep([0.5], [0.0, 1.0]), **settings)


def test_fewer_than_two_poses_are_refused() -> None:
    with pytest.raises(InputError, match="at least two valid poses, received 1"):
        synchronise(turning_sweep([0.5], [0.5]), max_gap_s=1.0)
