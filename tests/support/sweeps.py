"""A small tracked sweep whose every number is known, for tests of readers, writers and studies."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.sweep import ProbeCalibration, TrackedSweep

# Oblique, anisotropic and sheared, as calibrations in the wild are.
CALIBRATION = ProbeCalibration(
    ee_T_probe=transforms.from_rotation(
        Rotation.from_euler("xyz", [80, -20, 5], degrees=True), np.array([4.0, -3.0, 70.0])
    ),
    probe_A_pixel=np.array(
        [[0.12, 0.004, 0.0, -20.5], [0.001, 0.2, 0.0, 3.25], [0.0, 0.01, 0.16, 1.0], [0, 0, 0, 1.0]]
    ),
)


def world_T_ee(times_s: np.ndarray) -> np.ndarray:
    """The end effector's pose: turning at 20 degrees a second about an oblique axis, moving along a line."""
    times_s = np.asarray(times_s, dtype=np.float64)
    axis = np.array([1.0, 2.0, -2.0]) / 3
    rotation = Rotation.from_rotvec(np.deg2rad(20) * times_s[:, None] * axis)
    return transforms.from_rotation(
        rotation, np.stack([310 + 12 * times_s, -45 + 3 * times_s, 220 - 5 * times_s], axis=-1)
    )


def known_sweep(frame_count: int = 6, height: int = 8, width: int = 11) -> TrackedSweep:
    """Frames of random pixels at 10 Hz from 0.53 s, poses at 40 Hz from 0.5 s, on different clock ticks."""
    image_times_s = 0.53 + 0.1 * np.arange(frame_count)
    pose_times_s = 0.5 + 0.025 * np.arange(4 * frame_count + 4)
    images = np.random.default_rng(5).integers(0, 256, (frame_count, height, width)).astype(np.uint8)
    return TrackedSweep(images, image_times_s, world_T_ee(pose_times_s), pose_times_s, CALIBRATION)


def assert_same_sweep(found: TrackedSweep, expected: TrackedSweep, time_tolerance_s: float = 1e-9) -> None:
    """Pixels to the bit; times, poses and the whole chain from pixel to end effector to 1e-9."""
    np.testing.assert_array_equal(found.images, expected.images)
    np.testing.assert_allclose(found.image_times_s, expected.image_times_s, rtol=0, atol=time_tolerance_s)
    np.testing.assert_allclose(found.pose_times_s, expected.pose_times_s, rtol=0, atol=time_tolerance_s)
    np.testing.assert_allclose(found.world_T_ee, expected.world_T_ee, rtol=0, atol=1e-9)
    np.testing.assert_allclose(
        found.calibration.ee_A_pixel, expected.calibration.ee_A_pixel, rtol=0, atol=1e-9
    )
