"""The parts of a pose's error that a tubular vessel hides best: the roll about its axis and the slide along it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.errors import InputError


@dataclass(frozen=True)
class VesselError:
    """Errors of a pose along and about the vessel's principal axis.

    Parameters
    ----------
    roll_error_deg : float
        Rotation about the axis, 0 to 180 degrees.
    slide_error_mm : float
        Displacement along the axis in mm, from 0.
    """

    roll_error_deg: float
    slide_error_mm: float


def vessel_error(
    fixed_T_moving: Float64[np.ndarray, "4 4"],
    true_fixed_T_moving: Float64[np.ndarray, "4 4"],
    axis: Float64[np.ndarray, "3"],
    targets_mm: Float64[np.ndarray, "t 3"],
) -> VesselError:
    """Decompose the error of a pose into roll and slide, in the fixed coordinate frame.

    Parameters
    ----------
    fixed_T_moving : ndarray, shape (4, 4)
        Estimated pose.
    true_fixed_T_moving : ndarray, shape (4, 4)
        True pose.
    axis : ndarray, shape (3,)
        Direction of the vessel's principal axis, of any length.
    targets_mm : ndarray, shape (t, 3)
        Targets in the fixed coordinate frame in mm; the slide is that of their centroid.

    Returns
    -------
    VesselError
        Roll and slide.

    Raises
    ------
    InputError
        If a pose is not rigid, the axis has no length, or there are no finite targets.

    Notes
    -----
    The roll is the twist of the rotation's decomposition into a twist about the axis and a swing of it. After
    a flip it is that of the vessel laid back the shortest way; an exact flip leaves it undetermined.

    References
    ----------
    P. Dobrowolski, arXiv:1506.05481, 2015.
    """
    length = float(np.linalg.norm(axis))
    if not (np.isfinite(length) and length > 0):
        raise InputError(f"axis: expected a direction, received {axis.tolist()}")
    if not len(targets_mm) or not np.isfinite(targets_mm).all():
        raise InputError(f"targets_mm: expected finite targets, received {len(targets_mm)} with NaN or none")
    estimate = transforms.require_rigid(fixed_T_moving, "fixed_T_moving")
    truth = transforms.require_rigid(true_fixed_T_moving, "true_fixed_T_moving")
    error = transforms.compose(estimate, transforms.invert_rigid(truth))
    x, y, z, w = Rotation.from_matrix(error[:3, :3]).as_quat()
    along = float(np.array([x, y, z]) @ axis) / length
    roll_deg = np.rad2deg(2 * np.arctan2(abs(along), abs(w)))
    centre_mm = targets_mm.mean(axis=0)
    slide_mm = abs(float((transforms.apply(error, centre_mm) - centre_mm) @ axis)) / length
    return VesselError(float(roll_deg), slide_mm)
