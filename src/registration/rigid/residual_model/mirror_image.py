"""The mirror image as a rival: a vessel whose mirror image fits better was read the wrong way round, or is another."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64, Int64
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.geometry.shapes import principal_frame
from registration.rigid.icp.correspondence import TreeTarget
from registration.rigid.icp.estimation import PointToPlane
from registration.rigid.icp.loop import align
from registration.rigid.residual_model.grouped_residuals import GroupedResiduals, grouped_residuals

POINTS, ITERATIONS, TOLERANCE, DAMPING, KEEP = 300, 20, 1e-3, 0.01, 0.95
# Misfits below this, in mm, are the sampling's.
MIN_MISFIT_MM = 0.02


def misfit_mm(residuals: GroupedResiduals) -> float:
    """Compute how far groups lie from the surface at the best pose nearby, the noise of their points left out.

    Parameters
    ----------
    residuals : GroupedResiduals
        Residuals at a pose.

    Returns
    -------
    float
        Root mean square in mm.
    """
    fitted = np.linalg.lstsq(residuals.jacobian, residuals.gap_mm, rcond=None)[0]
    left_mm = residuals.gap_mm - residuals.jacobian @ fitted
    freedom = max(len(left_mm) - len(fitted), 1)
    structure_mm2 = float(left_mm @ left_mm) / freedom - residuals.noise_mm**2 / residuals.group_points
    return float(np.sqrt(max(structure_mm2, MIN_MISFIT_MM**2)))


def mirrored_misfit_mm(
    moving_mm: Float64[np.ndarray, "m 3"],
    target: TreeTarget,
    fixed_T_moving: Float64[np.ndarray, "4 4"],
    *,
    block: Int64[np.ndarray, " m"],
    offset: bool,
) -> float:
    """Compute the misfit of the mirror image of the moved cloud, from its three principal planes on settled.

    Parameters
    ----------
    moving_mm : ndarray, shape (m, 3)
        Moving points in mm, in random order.
    target : TreeTarget
        Fixed cloud with normals.
    fixed_T_moving : ndarray, shape (4, 4)
        Pose.
    block : ndarray of int, shape (m,)
        Group of each point that residuals are averaged over.
    offset : bool
        Whether the walls may lie apart by the same distance everywhere.

    Returns
    -------
    float
        Misfit in mm at the best place; infinite if it lies nowhere near the surface.
    """
    moved_mm = transforms.apply(fixed_T_moving, moving_mm)
    frame = principal_frame(moved_mm)
    shortest = frame.axes[:, 2]
    mirrored_mm = moved_mm - 2.0 * ((moved_mm - frame.centre_mm) @ shortest)[:, None] * shortest
    # Mirrored in another principal plane it is the same image, turned over about a principal axis.
    turns = Rotation.from_rotvec(np.pi * np.stack([np.zeros(3), frame.axes[:, 0], frame.axes[:, 1]]))
    settled = align(
        mirrored_mm[:POINTS],
        target,
        transforms.from_rotation(turns, frame.centre_mm - turns.apply(frame.centre_mm)),
        keep=KEEP,
        max_iterations=ITERATIONS,
        tolerance=TOLERANCE,
        estimation=PointToPlane(DAMPING, offset=offset),
    )
    best = settled.fixed_T_moving[int(settled.rmse_mm.argmin())]
    residuals = grouped_residuals(mirrored_mm, target, best, block=block, offset=offset)
    return float("inf") if residuals is None else misfit_mm(residuals) / residuals.share
