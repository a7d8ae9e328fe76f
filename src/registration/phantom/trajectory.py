"""The robot's path over the vessel: true probe poses, and the poses as they are recorded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.phantom.anatomy import Anatomy
from registration.phantom.conditions import Motion

WAYPOINTS = 7
# The sweep stays this far from the ends of the vessel, where a frame would show nothing.
ENDS_MM = 4.0


@dataclass(frozen=True)
class Path:
    """Smooth path of the probe in the anatomy's bed frame.

    The probe's x is lateral, z points into the body, y completes a right-handed frame.

    Parameters
    ----------
    duration_s : float
        End of the path in s; it begins at time 0.
    position_mm : CubicSpline
        Position on the skin in mm as a function of time in s.
    angles_deg : CubicSpline
        Euler angles (x, y, z) in degrees as a function of time.
    pressure_mm : CubicSpline
        Depth in mm to which the probe is pushed below the skin, along its z, as a function of time.
    sag_mm : float
        Distance in mm by which the ends of the array lie behind its middle.
    """

    duration_s: float
    position_mm: CubicSpline
    angles_deg: CubicSpline
    pressure_mm: CubicSpline
    sag_mm: float

    def at(self, times_s: Float64[np.ndarray, " n"]) -> Float64[np.ndarray, "n 4 4"]:
        """Evaluate the poses of the probe.

        Parameters
        ----------
        times_s : ndarray, shape (n,)
            Times in s.

        Returns
        -------
        ndarray, shape (n, 4, 4)
            ``bed_T_probe`` at each time.
        """
        # At rest the probe looks to the back (+y) with its x to the patient's left (+x).
        upright = Rotation.from_matrix([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
        turned = upright * Rotation.from_euler("xyz", self.angles_deg(times_s), degrees=True)
        pushed = np.zeros((len(times_s), 3))
        # A curved face is pushed in until its ends touch.
        pushed[:, 2] = self.pressure_mm(times_s) + self.sag_mm
        return transforms.from_rotation(turned, self.position_mm(times_s) + turned.apply(pushed))


def plan(
    anatomy: Anatomy, motion: Motion, pressure_mm: float, sag_mm: float, rng: np.random.Generator
) -> Path:
    """Plan a path that follows the vessel on the skin, with some tilt and wander.

    Start and direction are random. The probe keeps the vessel roughly in the middle, as an operator or a
    visual servo would.

    Parameters
    ----------
    anatomy : Anatomy
        Vessel and skin.
    motion : Motion
        Settings of the motion.
    pressure_mm : float
        Full pressure in mm; the probe presses with 0.4 to 1 of it.
    sag_mm : float
        Distance in mm by which the ends of the array lie behind its middle.
    rng : numpy.random.Generator
        Random stream of the path.

    Returns
    -------
    Path
        The true path.
    """
    guide_mm = anatomy.guide_mm
    low_mm, high_mm = guide_mm[0, 2] + ENDS_MM, guide_mm[-1, 2] - ENDS_MM
    length_mm = min(motion.length_mm, high_mm - low_mm)
    start_mm = low_mm + rng.random() * (high_mm - low_mm - length_mm)
    z_mm = np.linspace(start_mm, start_mm + length_mm, WAYPOINTS)
    middle_mm = np.interp(z_mm, guide_mm[:, 2], guide_mm[:, 0])
    position_mm = np.column_stack(
        [
            middle_mm + motion.wander_mm * rng.standard_normal(WAYPOINTS),
            np.full(WAYPOINTS, anatomy.skin_y_mm),
            z_mm,
        ]
    )
    # The same tilt throughout, as in an operator's habit, and some more that varies along the sweep.
    # Turns in the image plane stay small, because they would lift one end of the face off the skin.
    angles_deg = motion.tilt_deg * (0.7 * rng.uniform(-1, 1, 3) + 0.4 * rng.uniform(-1, 1, (WAYPOINTS, 3)))
    angles_deg *= [1.0, 0.35, 1.0]
    if rng.random() < 0.5:
        position_mm = position_mm[::-1]
    times_s = np.linspace(0.0, motion.duration_s, WAYPOINTS)
    pushed_mm = pressure_mm * rng.uniform(0.4, 1.0, WAYPOINTS)
    return Path(
        duration_s=motion.duration_s,
        position_mm=CubicSpline(times_s, position_mm),
        angles_deg=CubicSpline(times_s, angles_deg),
        pressure_mm=CubicSpline(times_s, pushed_mm),
        sag_mm=sag_mm,
    )


def disturb(
    A_T_B: Float64[np.ndarray, "n 4 4"], noise_mm: float, noise_deg: float, rng: np.random.Generator
) -> Float64[np.ndarray, "n 4 4"]:
    """Add pose noise: a small random motion in B to each pose, independent of the others.

    Parameters
    ----------
    A_T_B : ndarray, shape (n, 4, 4)
        True poses.
    noise_mm, noise_deg : float
        Standard deviation per coordinate in mm and in degrees.
    rng : numpy.random.Generator
        Random stream of the noise.

    Returns
    -------
    ndarray, shape (n, 4, 4)
        Poses as they are recorded.
    """
    count = len(A_T_B)
    rotation = Rotation.from_rotvec(noise_deg * rng.standard_normal((count, 3)), degrees=True)
    return A_T_B @ transforms.from_rotation(rotation, noise_mm * rng.standard_normal((count, 3)))


def random_rigid(rng: np.random.Generator, reach_mm: float) -> Float64[np.ndarray, "4 4"]:
    """Draw a rigid transform with a uniformly random rotation.

    Parameters
    ----------
    rng : numpy.random.Generator
        Random stream of the transform.
    reach_mm : float
        Largest shift of each coordinate in mm.

    Returns
    -------
    ndarray, shape (4, 4)
        The transform.
    """
    return transforms.from_rotation(Rotation.random(random_state=rng), rng.uniform(-reach_mm, reach_mm, 3))
