"""Landmark pairs as constraints of a deformable registration: material points whose displacement is known nearly."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64

from registration.checks import require_positive
from registration.errors import InputError
from registration.geometry.shapes import require_points
from registration.rigid.icp.estimation import motion_jacobian
from registration.rigid.residual_model.grouped_residuals import GroupedResiduals


@dataclass(frozen=True)
class LandmarkConstraints:
    """Points that are the same material in both clouds.

    Parameters
    ----------
    moving_mm : ndarray, shape (k, 3)
        Landmarks of the moving cloud in mm, in the frame of the fixed ones.
    fixed_mm : ndarray, shape (k, 3)
        The same landmarks as the sweep has them, in mm.
    deviation_mm : float, optional
        Standard deviation in mm, per coordinate, by which a pair is off: how surely it was placed on both sides.

    Raises
    ------
    InputError
        If there are no points, not as many on both sides, or the deviation is not above 0.
    """

    moving_mm: Float64[np.ndarray, "_ 3"]
    fixed_mm: Float64[np.ndarray, "_ 3"]
    deviation_mm: float = 1.0

    def __post_init__(self) -> None:
        for name in ("moving_mm", "fixed_mm"):
            object.__setattr__(self, name, require_points(getattr(self, name), f"landmarks {name}", 1))
        if len(self.moving_mm) != len(self.fixed_mm):
            raise InputError(
                f"landmarks: expected pairs, received {len(self.moving_mm)} moving and {len(self.fixed_mm)} fixed ones"
            )
        require_positive("landmarks deviation_mm", self.deviation_mm)


def with_landmarks(
    residuals: GroupedResiduals, landmarks: LandmarkConstraints, noise_mm2: float
) -> GroupedResiduals:
    """Add landmarks to the residuals of a wall: each asks for a displacement along all three axes.

    Parameters
    ----------
    residuals : GroupedResiduals
        Residuals of the wall.
    landmarks : LandmarkConstraints
        Landmarks in the same frame.
    noise_mm2 : float
        Variance in mm² of the noise of a group, which all variances are given in parts of.

    Returns
    -------
    GroupedResiduals
        Residuals of both. A landmark has no part in the errors of borders and frames.
    """
    places_mm = np.repeat(landmarks.moving_mm, 3, axis=0)
    axes = np.tile(np.eye(3), (len(landmarks.moving_mm), 1))
    jacobian = motion_jacobian((places_mm - residuals.centre_mm) / residuals.radius_mm, axes)
    # An offset of the walls does not move a landmark.
    jacobian = np.pad(jacobian, ((0, 0), (0, residuals.jacobian.shape[1] - jacobian.shape[1])))
    wall, more = len(residuals.gap_mm), len(places_mm)
    shared = residuals.shared_frames
    return replace(
        residuals,
        points_mm=np.concatenate([residuals.points_mm, places_mm]),
        normals=np.concatenate([residuals.normals, axes]),
        gap_mm=np.concatenate([residuals.gap_mm, (landmarks.fixed_mm - landmarks.moving_mm).ravel()]),
        jacobian=np.concatenate([residuals.jacobian, jacobian]),
        shared_frames=None if shared is None else np.pad(shared, (0, more)),
        own_noise=np.concatenate([np.ones(wall), np.full(more, landmarks.deviation_mm**2 / noise_mm2)]),
        on_wall=np.arange(wall + more) < wall,
    )
