"""The robot's path over the vessel: true probe poses, and the poses as they are recorded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from registration import frames
from registration.phantom.anatomy import Anatomy
from registration.phantom.settings import Motion

WAYPOINTS = 7


@dataclass(frozen=True)
class Path:
    """A smooth path of the probe: ``ct_T_probe`` at any time from 0 to ``duration_s``.

    The probe's x is lateral, z points into the body, y completes a right-handed frame.
    """

    duration_s: float
    position_mm: CubicSpline
    angles_deg: CubicSpline

    def at(self, times_s: Float64[np.ndarray, "n"]) -> Float64[np.ndarray, "n 4 4"]:
        """Pose of the probe at each time."""
        # At rest the probe looks to the back (+y) with its x to the patient's left (+x).
        upright = Rotation.from_matrix([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
        turned = upright * Rotation.from_euler("xyz", self.angles_deg(times_s), degrees=True)
        return frames.from_rotation(turned, self.position_mm(times_s))


def plan(anatomy: Anatomy, motion: Motion, rng: np.random.Generator) -> Path:
    """Follow the vessel's main line on the skin, with some tilt and wander; start and direction are random.

    The probe keeps the vessel roughly in the middle, as an operator or a visual servo would.
    """
    line = max(anatomy.centerline.lines, key=lambda candidate: candidate.length_mm)
    points_mm = np.concatenate([one.points_mm for one in anatomy.centerline.lines])
    low_mm, high_mm = points_mm[:, 2].min(), points_mm[:, 2].max()
    length_mm = min(motion.length_mm, high_mm - low_mm)
    start_mm = low_mm + rng.random() * (high_mm - low_mm - length_mm)
    z_mm = np.linspace(start_mm, start_mm + length_mm, WAYPOINTS)
    near = [np.abs(points_mm[:, 2] - z) < 2.0 for z in z_mm]
    middle_mm = np.array(
        [points_mm[close, 0].mean() if close.any() else line.points_mm[:, 0].mean() for close in near]
    )
    position_mm = np.column_stack(
        [
            middle_mm + motion.wander_mm * rng.standard_normal(WAYPOINTS),
            np.full(WAYPOINTS, anatomy.skin_y_mm),
            z_mm,
        ]
    )
    # The same tilt throughout, as in an operator's habit, and some more that varies along the sweep.
    angles_deg = motion.tilt_deg * (0.7 * rng.uniform(-1, 1, 3) + 0.4 * rng.uniform(-1, 1, (WAYPOINTS, 3)))
    if rng.random() < 0.5:
        position_mm = position_mm[::-1]
    times_s = np.linspace(0.0, motion.duration_s, WAYPOINTS)
    return Path(motion.duration_s, CubicSpline(times_s, position_mm), CubicSpline(times_s, angles_deg))


def disturb(
    world_T_ee: Float64[np.ndarray, "n 4 4"], motion: Motion, rng: np.random.Generator
) -> Float64[np.ndarray, "n 4 4"]:
    """The poses as recorded: each true one with a small random motion of its own."""
    count = len(world_T_ee)
    rotation = Rotation.from_rotvec(motion.noise_deg * rng.standard_normal((count, 3)), degrees=True)
    return frames.compose(
        world_T_ee, frames.from_rotation(rotation, motion.noise_mm * rng.standard_normal((count, 3)))
    )


def random_rigid(rng: np.random.Generator, reach_mm: float) -> Float64[np.ndarray, "4 4"]:
    """A rigid transform with a uniformly random rotation and each coordinate's shift within ``reach_mm``."""
    return frames.from_rotation(Rotation.random(random_state=rng), rng.uniform(-reach_mm, reach_mm, 3))
