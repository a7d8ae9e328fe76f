"""Errors of a result for a benchmark case against the truth, also up to the vessel's symmetry."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from jaxtyping import Float64

from registration import transforms
from registration.benchmark.cases import BenchmarkCase, CaseTruth
from registration.errors import InputError
from registration.geometry.shapes import principal_frame
from registration.metrics.pose_error import vessel_error
from registration.metrics.surface_distance import (
    SUCCESS_RMSE_MM,
    SUCCESS_TRE_MM,
    SurfaceDistance,
    pose_error,
    rms,
)

INFINITE, NOT_DEFINED = float("inf"), float("nan")


@dataclass(frozen=True)
class PoseScore:
    """Errors of one result; all infinite without a result, NaN where the model is that of another vessel.

    Where tissue deforms, a target is off by the distance between it and where the pose puts its material as it was
    swept: what no rigid pose undoes is in it. ``tre_rigid_mm`` and the errors after it are against the true rigid pose,
    and leave that out.

    Parameters
    ----------
    rmse_mm : float, optional
        Root mean square distance in mm of the moving points that are no outliers to the model's triangles;
        NaN where the case itself is not at hand.
    tre_mm, tre_max_mm : float, optional
        Root mean square and largest target registration error in mm, over all targets.
    tre_covered_mm, tre_uncovered_mm : float, optional
        The same root mean square over the targets that were swept and those that were not; NaN where there
        are none.
    tre_symmetric_mm : float, optional
        Target registration error in mm against the nearest of all poses that are equally right.
    tre_rigid_mm : float, optional
        Root mean square displacement of the targets in mm against the true rigid pose.
    rotation_error_deg : float, optional
        Angle between estimated and true pose in degrees.
    translation_error_mm : float, optional
        Displacement of the targets' centroid in mm.
    roll_error_deg : float, optional
        Rotation about the targets' longest axis in degrees.
    slide_error_mm : float, optional
        Displacement along that axis in mm.
    """

    rmse_mm: float = INFINITE
    tre_mm: float = INFINITE
    tre_max_mm: float = INFINITE
    tre_covered_mm: float = INFINITE
    tre_uncovered_mm: float = INFINITE
    tre_symmetric_mm: float = INFINITE
    tre_rigid_mm: float = INFINITE
    rotation_error_deg: float = INFINITE
    translation_error_mm: float = INFINITE
    roll_error_deg: float = INFINITE
    slide_error_mm: float = INFINITE

    @property
    def success(self) -> bool:
        """Whether the residual is small, which alone says little about the pose."""
        return self.rmse_mm <= SUCCESS_RMSE_MM

    @property
    def success_tre(self) -> bool:
        """Whether the pose is right within ``SUCCESS_TRE_MM``."""
        return self.tre_mm <= SUCCESS_TRE_MM

    @property
    def success_tre_symmetric(self) -> bool:
        """Whether the pose is one of those that are right, within ``SUCCESS_TRE_MM``."""
        return self.tre_symmetric_mm <= SUCCESS_TRE_MM


def score_pose(
    fixed_T_moving: Float64[np.ndarray, "4 4"], truth: CaseTruth, case: BenchmarkCase | None = None
) -> PoseScore:
    """Measure the errors of one result.

    Parameters
    ----------
    fixed_T_moving : ndarray, shape (4, 4)
        Estimated pose.
    truth : CaseTruth
        Truth of the case.
    case : BenchmarkCase or None, optional
        The case itself, for the residual; None leaves it NaN.

    Returns
    -------
    PoseScore
        Errors of the result.

    Raises
    ------
    InputError
        If the pose is not rigid, or the case is not that of the truth.
    """
    if case is not None and len(case.moving_mm) != len(truth.outlier):
        raise InputError(
            f"case: expected {len(truth.outlier)} moving points as the truth of {truth.name} says, "
            f"received {len(case.moving_mm)}"
        )
    rmse_mm = NOT_DEFINED if case is None else _residual_mm(fixed_T_moving, truth, case)
    if not truth.same_vessel:
        transforms.require_rigid(fixed_T_moving, "fixed_T_moving")
        return replace(PoseScore(*[NOT_DEFINED] * len(fields(PoseScore))), rmse_mm=rmse_mm)
    error = pose_error(fixed_T_moving, truth.fixed_T_moving, truth.targets_mm)
    apart_mm = material_error_mm(fixed_T_moving, truth)
    roll_deg, slide_mm = roll_and_slide(fixed_T_moving, truth.fixed_T_moving, truth.targets_mm)
    symmetric_mm = rms(apart_mm)
    if truth.symmetry:
        nearest = truth.symmetry.nearest(fixed_T_moving, truth.fixed_T_moving, truth.targets_mm)
        symmetric_mm = min(symmetric_mm, pose_error(fixed_T_moving, nearest, truth.targets_mm).tre_mm)
    return PoseScore(
        rmse_mm=rmse_mm,
        tre_mm=rms(apart_mm),
        tre_max_mm=float(apart_mm.max()),
        tre_covered_mm=_part(apart_mm, truth.covered),
        tre_uncovered_mm=_part(apart_mm, ~truth.covered),
        tre_symmetric_mm=symmetric_mm,
        tre_rigid_mm=error.tre_mm,
        rotation_error_deg=error.rotation_error_deg,
        translation_error_mm=error.translation_error_mm,
        roll_error_deg=roll_deg,
        slide_error_mm=slide_mm,
    )


def material_error_mm(
    fixed_T_moving: Float64[np.ndarray, "4 4"],
    truth: CaseTruth,
    displacement_mm: Float64[np.ndarray, "t 3"] | None = None,
) -> Float64[np.ndarray, " t"]:
    """Measure how far the model's targets are from where their material was swept.

    Parameters
    ----------
    fixed_T_moving : ndarray, shape (4, 4)
        Estimated pose.
    truth : CaseTruth
        Truth of the case.
    displacement_mm : ndarray, shape (t, 3), or None, optional
        Displacement in mm of each target of the model in the fixed frame, by a deformable method; None for none.

    Returns
    -------
    ndarray, shape (t,)
        Distances in mm.
    """
    shown_mm = truth.targets_mm
    if truth.displacement_mm is not None:
        shown_mm = shown_mm + truth.displacement_mm
    error = transforms.compose(fixed_T_moving, transforms.invert_rigid(truth.fixed_T_moving))
    apart_mm = transforms.apply(error, shown_mm) - truth.targets_mm
    if displacement_mm is not None:
        apart_mm = apart_mm - displacement_mm
    return np.asarray(np.linalg.norm(apart_mm, axis=1))


def roll_and_slide(
    fixed_T_moving: Float64[np.ndarray, "4 4"],
    true_fixed_T_moving: Float64[np.ndarray, "4 4"],
    targets_mm: Float64[np.ndarray, "t 3"],
) -> tuple[float, float]:
    """Measure the rotation about the targets' longest axis and the displacement along it.

    Parameters
    ----------
    fixed_T_moving : ndarray, shape (4, 4)
        Estimated pose.
    true_fixed_T_moving : ndarray, shape (4, 4)
        True pose.
    targets_mm : ndarray, shape (t, 3)
        Targets in the fixed frame in mm.

    Returns
    -------
    roll_deg : float
        Rotation about the axis, 0 to 180 degrees.
    slide_mm : float
        Displacement of the targets' centroid along the axis in mm, from 0.

    Notes
    -----
    See ``registration.metrics.pose_error``.
    """
    axis = principal_frame(targets_mm).axes[:, 0]
    found = vessel_error(fixed_T_moving, true_fixed_T_moving, axis, targets_mm)
    return found.roll_error_deg, found.slide_error_mm


def lowest_tre_mm(truth: CaseTruth) -> float:
    """Compute the target registration error of the true pose: what tissue's deformation leaves to a rigid one.

    Parameters
    ----------
    truth : CaseTruth
        Truth of the case.

    Returns
    -------
    float
        Root mean square in mm; 0 where tissue does not deform, NaN where the model is that of another vessel.
    """
    if not truth.same_vessel:
        return NOT_DEFINED
    return 0.0 if truth.displacement_mm is None else rms(np.linalg.norm(truth.displacement_mm, axis=1))


def _residual_mm(fixed_T_moving: np.ndarray, truth: CaseTruth, case: BenchmarkCase) -> float:
    genuine_mm = transforms.apply(fixed_T_moving, case.moving_mm[~truth.outlier])
    return rms(SurfaceDistance(case.fixed)(genuine_mm))


def _part(apart_mm: np.ndarray, chosen: np.ndarray) -> float:
    return rms(apart_mm[chosen]) if chosen.any() else NOT_DEFINED
