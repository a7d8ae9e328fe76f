"""One trial of the robustness study, as a task that any process can run."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from registration import frames
from registration.metrics import Surface, SurfaceDistance, pose_error, rms
from registration.perturbation import Perturbation, Piece, Trial

if TYPE_CHECKING:
    from registration.results import RigidResult

# What success means: in the thesis's sense, and against the truth.
SUCCESS_RMSE_MM = 1.0
SUCCESS_TRE_MM = 2.0

ERRORS = (
    "rmse_mm",
    "tre_mm",
    "tre_max_mm",
    "tre_covered_mm",
    "tre_uncovered_mm",
    "rotation_error_deg",
    "translation_error_mm",
)


@dataclass(frozen=True)
class RobustnessTrial:
    """A method, the surfaces and how they are perturbed; called with a trial's number it gives that trial's row.

    ``true_fixed_T_moving`` is the pose before the perturbation, ``targets_mm`` (t, 3) lie in the fixed frame,
    and ``covered`` (t,) says which of them lie beside what moves.
    """

    name: str
    method: Callable[[np.ndarray, np.ndarray], RigidResult]
    perturbation: Perturbation
    piece: Piece
    moving: Surface
    fixed: Surface
    true_fixed_T_moving: np.ndarray
    targets_mm: np.ndarray
    covered: np.ndarray
    seed: int

    def __call__(self, number: int) -> dict[str, Any]:
        """Draw the problem, solve it, and measure the answer; a method that raises has failed."""
        trial = self.perturbation(
            self.moving, self.fixed, self.true_fixed_T_moving, self.piece, seed=self.seed, trial=number
        )
        row: dict[str, Any] = {
            "trial": number,
            "method": self.name,
            "overlap": float(self.piece.share),
            "piece": self.piece.place,
            "angle_deg": trial.angle_deg,
            "translation_mm": trial.translation_mm,
        }
        begin_s = time.perf_counter()
        try:
            result = self.method(trial.moving_mm, trial.fixed_mm)
            frames.require_rigid(result.fixed_T_moving, "fixed_T_moving")
        except Exception as failure:  # whatever a method does wrong, the trial counts and the others go on
            found: dict[str, Any] = dict.fromkeys(ERRORS, float("inf"))
            found |= {"converged": False, "iterations": 0, "candidates": 0}
            found["runtime_s"] = time.perf_counter() - begin_s
            found["error"] = f"{type(failure).__name__}: {failure}"
        else:
            found = self._measured(trial, result)
        success = {
            "success": bool(found["rmse_mm"] <= SUCCESS_RMSE_MM),
            "success_tre": bool(found["tre_mm"] <= SUCCESS_TRE_MM),
        }
        return row | found | success

    def _measured(self, trial: Trial, result: RigidResult) -> dict[str, Any]:
        pose = result.fixed_T_moving
        error = pose_error(pose, trial.fixed_T_moving, self.targets_mm)
        genuine_mm = trial.moving_mm[~trial.outlier]
        return {
            "rmse_mm": rms(SurfaceDistance(self.fixed)(frames.apply(pose, genuine_mm))),
            "tre_mm": error.tre_mm,
            "tre_max_mm": error.tre_max_mm,
            "tre_covered_mm": self._part(pose, trial, self.covered),
            "tre_uncovered_mm": self._part(pose, trial, ~self.covered),
            "rotation_error_deg": error.rotation_error_deg,
            "translation_error_mm": error.translation_error_mm,
            "converged": result.converged,
            "iterations": result.iterations,
            "candidates": len(result.candidates),
            "runtime_s": result.runtime_s,
            "error": "",
        }

    def _part(self, pose: np.ndarray, trial: Trial, chosen: np.ndarray) -> float:
        """The error over some of the targets; NaN where there are none."""
        if not chosen.any():
            return float("nan")
        return pose_error(pose, trial.fixed_T_moving, self.targets_mm[chosen]).tre_mm
