"""How far an answer to a benchmark case is from the truth, also up to the vessel's symmetry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from registration import frames
from registration.benchmark.cases import BenchmarkCase, CaseTruth
from registration.errors import InputError
from registration.geometry import principal_frame
from registration.metrics import SUCCESS_RMSE_MM, SUCCESS_TRE_MM, SurfaceDistance, pose_error, rms
from registration.vessel_error import vessel_error

INFINITE, NOT_DEFINED = float("inf"), float("nan")


@dataclass(frozen=True)
class PoseScore:
    """The errors of one answer; all infinite for none.

    ``rmse_mm`` is from the genuine moving points to the model's triangles, NaN where the case itself is not at hand.
    ``tre_mm`` is over all targets, ``tre_covered_mm`` and ``tre_uncovered_mm`` over those that were swept and those
    that were not (NaN where there are none). ``roll_error_deg`` is the turn about the targets' longest axis,
    ``slide_error_mm`` the shift along it. ``tre_symmetric_mm`` is ``tre_mm`` against the nearest of all poses that are
    as right as the true one.
    """

    rmse_mm: float = INFINITE
    tre_mm: float = INFINITE
    tre_max_mm: float = INFINITE
    tre_covered_mm: float = INFINITE
    tre_uncovered_mm: float = INFINITE
    tre_symmetric_mm: float = INFINITE
    rotation_error_deg: float = INFINITE
    translation_error_mm: float = INFINITE
    roll_error_deg: float = INFINITE
    slide_error_mm: float = INFINITE

    @property
    def success(self) -> bool:
        """Whether the residual is small: success in the sense that proves little."""
        return self.rmse_mm <= SUCCESS_RMSE_MM

    @property
    def success_tre(self) -> bool:
        """Whether the pose is right."""
        return self.tre_mm <= SUCCESS_TRE_MM

    @property
    def success_tre_symmetric(self) -> bool:
        """Whether the pose is one of those that are right."""
        return self.tre_symmetric_mm <= SUCCESS_TRE_MM


def score_pose(
    fixed_T_moving: Float64[np.ndarray, "4 4"], truth: CaseTruth, case: BenchmarkCase | None = None
) -> PoseScore:
    """Measure one answer; InputError for one that is not rigid, or a case that is not the truth's."""
    if case is not None and len(case.moving_mm) != len(truth.outlier):
        raise InputError(
            f"case: expected {len(truth.outlier)} moving points as the truth of {truth.name} says, "
            f"received {len(case.moving_mm)}"
        )
    error = pose_error(fixed_T_moving, truth.fixed_T_moving, truth.targets_mm)
    roll_deg, slide_mm = roll_and_slide(fixed_T_moving, truth.fixed_T_moving, truth.targets_mm)
    symmetric_mm = error.tre_mm
    if truth.symmetry:
        nearest = truth.symmetry.nearest(fixed_T_moving, truth.fixed_T_moving, truth.targets_mm)
        symmetric_mm = min(symmetric_mm, pose_error(fixed_T_moving, nearest, truth.targets_mm).tre_mm)
    rmse_mm = NOT_DEFINED
    if case is not None:
        genuine_mm = frames.apply(fixed_T_moving, case.moving_mm[~truth.outlier])
        rmse_mm = rms(SurfaceDistance(case.fixed)(genuine_mm))
    return PoseScore(
        rmse_mm=rmse_mm,
        tre_mm=error.tre_mm,
        tre_max_mm=error.tre_max_mm,
        tre_covered_mm=_part(fixed_T_moving, truth, truth.covered),
        tre_uncovered_mm=_part(fixed_T_moving, truth, ~truth.covered),
        tre_symmetric_mm=symmetric_mm,
        rotation_error_deg=error.rotation_error_deg,
        translation_error_mm=error.translation_error_mm,
        roll_error_deg=roll_deg,
        slide_error_mm=slide_mm,
    )


def roll_and_slide(
    fixed_T_moving: Float64[np.ndarray, "4 4"],
    true_fixed_T_moving: Float64[np.ndarray, "4 4"],
    targets_mm: Float64[np.ndarray, "t 3"],
) -> tuple[float, float]:
    """The turn about the targets' longest axis, 0 to 180 degrees, and the shift of their centroid along it, in mm.

    See ``registration.vessel_error``.
    """
    axis = principal_frame(targets_mm).axes[:, 0]
    found = vessel_error(fixed_T_moving, true_fixed_T_moving, axis, targets_mm)
    return found.roll_error_deg, found.slide_error_mm


def _part(fixed_T_moving: np.ndarray, truth: CaseTruth, chosen: np.ndarray) -> float:
    if not chosen.any():
        return NOT_DEFINED
    return pose_error(fixed_T_moving, truth.fixed_T_moving, truth.targets_mm[chosen]).tre_mm
