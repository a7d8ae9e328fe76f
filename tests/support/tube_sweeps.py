"""A tracked sweep across a straight tube, drawn by formula: every mask, pose and the surface itself are known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.sweep import ProbeCalibration, TrackedSweep

RADIUS_MM, PIXEL_MM, STEP_MM = 4.0, 0.25, 0.5
WORLD_T_TUBE = transforms.from_rotation(
    Rotation.from_euler("xyz", [25, -40, 70], degrees=True), np.array([310.0, -95.0, 220.0])
)


@dataclass(frozen=True)
class TubeSweep:
    """``sweep`` with black images; exact ``masks``, smooth ``probability`` (n, h, w) and the ends of the axis."""

    sweep: TrackedSweep
    masks: np.ndarray
    probability: np.ndarray
    axis_mm: np.ndarray

    def off_axis_mm(self, points_mm: np.ndarray) -> np.ndarray:
        """Distance of points to the straight line through the axis."""
        along = self.axis_mm[1] - self.axis_mm[0]
        along /= np.linalg.norm(along)
        away_mm = points_mm - self.axis_mm[0]
        return np.linalg.norm(away_mm - (away_mm @ along)[:, None] * along, axis=1)


def tube_sweep(count: int = 41, size_px: int = 56) -> TubeSweep:
    """``count`` frames at right angles to the tube, whose axis runs through the middle of each."""
    middle_px = (size_px - 1) / 2
    row, column = np.mgrid[:size_px, :size_px]
    outside_mm = PIXEL_MM * np.hypot(column - middle_px, row - middle_px) - RADIUS_MM
    probability = (1 / (1 + np.exp(outside_mm / 0.3))).astype(np.float32)
    probe_A_pixel = np.diag([PIXEL_MM, PIXEL_MM, PIXEL_MM, 1.0])
    probe_A_pixel[:2, 3] = -PIXEL_MM * middle_px
    ee_T_probe = transforms.translation((3.0, -2.0, 120.0))
    tube_T_probe = np.stack([transforms.translation((0.0, 0.0, STEP_MM * index)) for index in range(count)])
    world_T_ee = WORLD_T_TUBE @ tube_T_probe @ transforms.invert_rigid(ee_T_probe)
    times_s = 0.05 * np.arange(count)
    sweep = TrackedSweep(
        images=np.zeros((count, size_px, size_px), dtype=np.uint8),
        image_times_s=times_s,
        world_T_ee=world_T_ee,
        pose_times_s=times_s,
        calibration=ProbeCalibration(ee_T_probe, probe_A_pixel),
    )
    ends_mm = transforms.apply(WORLD_T_TUBE, np.array([[0.0, 0, 0], [0, 0, STEP_MM * (count - 1)]]))
    stacked = np.broadcast_to(probability, (count, size_px, size_px)).copy()
    return TubeSweep(sweep, stacked >= 0.5, stacked, ends_mm)
