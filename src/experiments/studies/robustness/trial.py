"""One trial of the robustness study, as a task that any process can run."""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.studies.robustness.design import WHOLE, Condition
from registration import transforms
from registration.geometry.shapes import Surface
from registration.geometry.vessel_axis import AlongVessel
from registration.metrics.pose_error import vessel_error
from registration.metrics.surface_distance import (
    SUCCESS_RMSE_MM,
    SUCCESS_TRE_MM,
    SurfaceDistance,
    pose_error,
    rms,
)
from registration.perturbation.perturbation import Piece, Trial
from registration.perturbation.random_pose import FLIP
from registration.rigid.result import ACCEPTED, FAILED

if TYPE_CHECKING:
    from registration.rigid.result import RigidResult

# What success means: in the thesis's sense, and against the truth.
# The bins that angles are counted in where the perturbation has none, and the level of the predicted error.
ANGLE_BIN_DEG = 15.0
TRE_LEVEL = 0.9

ERRORS = (
    "rmse_mm",
    "tre_mm",
    "tre_max_mm",
    "tre_covered_mm",
    "tre_uncovered_mm",
    "rotation_error_deg",
    "translation_error_mm",
    "roll_error_deg",
    "slide_error_mm",
)


@dataclass(frozen=True)
class RobustnessTrial:
    """One method, the surfaces and how they are disturbed.

    Parameters
    ----------
    anatomy : str
        Name of the anatomy.
    name : str
        Name of the method.
    method : callable
        Rigid registration method.
    conditions : tuple of Condition
        Conditions of the job.
    piece : Piece
        Piece of the moving surface.
    moving, fixed : Surface
        Surface in mm.
    true_fixed_T_moving : ndarray, shape (4, 4)
        True pose before the perturbation.
    targets_mm : ndarray, shape (t, 3)
        Targets in the fixed frame in mm.
    covered : ndarray of bool, shape (t,)
        Which targets lie next to what moves.
    hand_centerlines : bool
        True if the targets are the fixed centerline, and the method is given it and its covered part, as a
        perfect extraction would find them.
    seed : int
        Seed of the trials.
    """

    anatomy: str
    name: str
    method: Callable[..., RigidResult]
    conditions: tuple[Condition, ...]
    piece: Piece
    moving: Surface
    fixed: Surface
    true_fixed_T_moving: np.ndarray
    targets_mm: np.ndarray
    covered: np.ndarray
    hand_centerlines: bool
    seed: int

    def __call__(self, key: tuple[int, int]) -> dict[str, Any]:
        """Draw the problem, solve it, and measure the result; a method that raises has failed.

        Parameters
        ----------
        key : tuple[int, int]
            Numbers of the condition and of the trial.

        Returns
        -------
        dict
            Row of the trial.
        """
        condition, number = self.conditions[key[0]], key[1]
        perturbation = condition.perturbation
        trial = perturbation(
            self.moving, self.fixed, self.true_fixed_T_moving, self.piece, seed=self.seed, trial=number
        )
        begin_s = time.perf_counter()
        try:
            result = self.method(trial.moving_mm, trial.fixed_mm, **self._more(trial))
            transforms.require_rigid(result.fixed_T_moving, "fixed_T_moving")
        except Exception as failure:  # whatever a method does wrong, the trial counts and the others go on
            found = _without_result(failure, time.perf_counter() - begin_s)
        else:
            found = self._errors(result.fixed_T_moving, trial) | self._judgement(result)
        success = {
            "success": bool(found["rmse_mm"] <= SUCCESS_RMSE_MM),
            "success_tre": bool(found["tre_mm"] <= SUCCESS_TRE_MM),
        }
        return self._levels(condition, number, trial) | found | success

    def _more(self, trial: Trial) -> dict[str, Any]:
        """What a method is given besides the clouds, if it has a use for it."""
        offered: dict[str, Any] = {"moving_frame": trial.frame}
        if self.hand_centerlines:
            own_mm = transforms.apply(
                transforms.invert_rigid(trial.fixed_T_moving), self.targets_mm[self.covered]
            )
            offered |= {"moving_centerline_mm": own_mm, "fixed_centerline_mm": self.targets_mm}
        # A tested object has its parameters on the call; a plain function on itself.
        taken = inspect.signature(self.method).parameters
        return {name: value for name, value in offered.items() if name in taken}

    def _levels(self, condition: Condition, number: int, trial: Trial) -> dict[str, Any]:
        perturbation = condition.perturbation
        width_deg = perturbation.angle_bin_deg or ANGLE_BIN_DEG
        last_deg = max(np.ceil(perturbation.angle_max_deg / width_deg) - 1, 0.0)
        begin_deg = width_deg * min(np.floor(trial.angle_deg / width_deg), last_deg)
        has_bin = perturbation.rotation != FLIP
        return {
            "anatomy": self.anatomy,
            "method": self.name,
            "factor": condition.factor,
            "level": condition.level,
            "rotation": perturbation.rotation,
            "overlap": float(self.piece.share),
            "place": WHOLE if self.piece.share == 1 else self.piece.place,
            "trial": number,
            "angle_deg": trial.angle_deg,
            "angle_from_deg": float(begin_deg) if has_bin else float("nan"),
            "angle_to_deg": float(begin_deg + width_deg) if has_bin else float("nan"),
            "translation_mm": trial.translation_mm,
            "noise_mm": float(perturbation.noise_mm),
            "outlier_share": float(perturbation.outlier_share),
            "missing_share": float(perturbation.missing_share),
            "missing": trial.loss if perturbation.missing_share else "",
        }

    def _errors(self, pose: np.ndarray, trial: Trial) -> dict[str, Any]:
        error = pose_error(pose, trial.fixed_T_moving, self.targets_mm)
        axis = AlongVessel.of(self.fixed).axis
        along = vessel_error(pose, trial.fixed_T_moving, axis, self.targets_mm)
        genuine_mm = trial.moving_mm[~trial.outlier]
        return {
            "rmse_mm": rms(SurfaceDistance(self.fixed)(transforms.apply(pose, genuine_mm))),
            "tre_mm": error.tre_mm,
            "tre_max_mm": error.tre_max_mm,
            "tre_covered_mm": self._part(pose, trial, self.covered),
            "tre_uncovered_mm": self._part(pose, trial, ~self.covered),
            "rotation_error_deg": error.rotation_error_deg,
            "translation_error_mm": error.translation_error_mm,
            "roll_error_deg": along.roll_error_deg,
            "slide_error_mm": along.slide_error_mm,
        }

    def _judgement(self, result: RigidResult) -> dict[str, Any]:
        """What the method says of its own result."""
        low_mm, high_mm = result.tre_interval_mm(self.targets_mm, TRE_LEVEL)
        return {
            "verdict": result.verdict,
            "accepted": bool(result.verdict == ACCEPTED),
            "ambiguity_gap": float(result.ambiguity_gap),
            "weak_directions": ",".join(result.weak_directions),
            "tre_low_mm": low_mm,
            "tre_high_mm": high_mm,
            "converged": bool(result.converged),
            "iterations": int(result.iterations),
            "candidates": len(result.candidates),
            "runtime_s": float(result.runtime_s),
            "error": "",
        }

    def _part(self, pose: np.ndarray, trial: Trial, chosen: np.ndarray) -> float:
        """The error over some of the targets; NaN where there are none."""
        if not chosen.any():
            return float("nan")
        return pose_error(pose, trial.fixed_T_moving, self.targets_mm[chosen]).tre_mm


def _without_result(failure: Exception, runtime_s: float) -> dict[str, Any]:
    """A method that raised: infinite errors, nothing predicted, and the reason."""
    return {
        **dict.fromkeys(ERRORS, float("inf")),
        "verdict": FAILED,
        "accepted": False,
        "ambiguity_gap": float("nan"),
        "weak_directions": "",
        "tre_low_mm": float("nan"),
        "tre_high_mm": float("nan"),
        "converged": False,
        "iterations": 0,
        "candidates": 0,
        "runtime_s": runtime_s,
        "error": f"{type(failure).__name__}: {failure}",
    }
