"""Where the tissue at the targets of a simulated sweep was swept, and by how far a result is off it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64

from registration import transforms
from registration.geometry.rigid_fit import kabsch
from registration.phantom.scan import SimulatedSweep

# A target is covered if the plane of a frame passes it within this distance in mm, or within the distance of two frames
# where these lie farther apart.
COVERED_MM = 1.0
# The rigid part of a motion is told by so many points of the wall.
WALL_POINTS = 2000


def passed(
    sweep: SimulatedSweep,
    used: Int64[np.ndarray, " k"],
    shown_mm: Float64[np.ndarray, "t 3"],
    within_mm: float = COVERED_MM,
) -> Bool[np.ndarray, " t"]:
    """Tell which places the true planes of frames pass.

    Parameters
    ----------
    sweep : SimulatedSweep
        Simulated sweep.
    used : ndarray of int, shape (k,)
        Indices of the frames.
    shown_mm : ndarray, shape (t, 3)
        Places in the ct frame in mm, at the time of the sweep.
    within_mm : float, optional
        Distance from a plane in mm that counts as passed.

    Returns
    -------
    ndarray of bool, shape (t,)
        Whether a plane passes each place.
    """
    ct_A_pixel = sweep.ct_T_world @ sweep.world_A_pixel[used]
    facing = np.cross(ct_A_pixel[:, :3, 0], ct_A_pixel[:, :3, 1])
    facing /= np.linalg.norm(facing, axis=1, keepdims=True)
    away_mm = np.einsum("tfk,fk->tf", shown_mm[:, None] - ct_A_pixel[None, :, :3, 3], facing)
    return np.asarray(np.abs(away_mm).min(axis=1) <= within_mm)


def true_rigid_part(sweep: SimulatedSweep) -> Float64[np.ndarray, "4 4"]:
    """Compute the rigid part of a sweep's deformation.

    Parameters
    ----------
    sweep : SimulatedSweep
        Simulated sweep.

    Returns
    -------
    ndarray, shape (4, 4)
        Rigid transform in the ct frame that brings the wall of the whole model, as swept, nearest to where it is in the
        CT (least squares).
    """
    vertices_mm = sweep.model.vertices_mm
    wall_mm = vertices_mm[:: max(len(vertices_mm) // WALL_POINTS, 1)]
    return kabsch(sweep.deformation.as_swept(wall_mm), wall_mm)


@dataclass(frozen=True)
class MaterialTruth:
    """Targets of a simulated sweep's model, and where their tissue was swept.

    Parameters
    ----------
    targets_mm : ndarray, shape (t, 3)
        Targets of the model in the ct frame in mm.
    swept_mm : ndarray, shape (t, 3)
        Where their tissue lay in mm in the world frame when the image plane passed it nearest.
    covered : ndarray of bool, shape (t,)
        Which of them a frame has passed.
    ct_T_world : ndarray, shape (4, 4)
        True rigid pose: that with which the sweep was simulated, and after it the rigid part of the deformation.
    """

    targets_mm: Float64[np.ndarray, "t 3"]
    swept_mm: Float64[np.ndarray, "t 3"]
    covered: Bool[np.ndarray, " t"]
    ct_T_world: Float64[np.ndarray, "4 4"]

    def errors_mm(
        self,
        ct_T_world: Float64[np.ndarray, "4 4"],
        displacement_mm: Float64[np.ndarray, "t 3"] | None = None,
    ) -> Float64[np.ndarray, " t"]:
        """Measure how far the model's targets are from where their tissue was swept.

        Parameters
        ----------
        ct_T_world : ndarray, shape (4, 4)
            Pose that a registration found.
        displacement_mm : ndarray, shape (t, 3), or None, optional
            Displacement in mm of each target in the ct frame, by a deformable method; None for none.

        Returns
        -------
        ndarray, shape (t,)
            Distances in mm.
        """
        apart_mm = transforms.apply(ct_T_world, self.swept_mm) - self.targets_mm
        return np.asarray(
            np.linalg.norm(apart_mm if displacement_mm is None else apart_mm - displacement_mm, axis=1)
        )


def material_truth(
    sweep: SimulatedSweep, targets_mm: Float64[np.ndarray, "t 3"], used: Int64[np.ndarray, " k"]
) -> MaterialTruth:
    """Compute where the tissue at targets was swept, and which targets were covered.

    Parameters
    ----------
    sweep : SimulatedSweep
        Simulated sweep.
    targets_mm : ndarray, shape (t, 3)
        Targets in the ct frame in mm, where the CT shows them.
    used : ndarray of int, shape (k,)
        Indices of the frames that are used.

    Returns
    -------
    MaterialTruth
        The targets with their tissue.
    """
    shown_mm = sweep.deformation.as_swept(targets_mm)
    origins_mm = sweep.world_A_pixel[used][:, :3, 3]
    apart_mm = np.linalg.norm(np.diff(origins_mm, axis=0), axis=1)
    within_mm = max(COVERED_MM, float(np.median(apart_mm))) if len(apart_mm) else COVERED_MM
    return MaterialTruth(
        targets_mm,
        transforms.apply(transforms.invert_rigid(sweep.ct_T_world), shown_mm),
        passed(sweep, used, shown_mm, within_mm),
        transforms.compose(true_rigid_part(sweep), sweep.ct_T_world),
    )
