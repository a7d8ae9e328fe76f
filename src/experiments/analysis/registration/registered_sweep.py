"""A simulated sweep registered to the model from its CT, rigidly and then deformably, with its errors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.analysis.registration.deformed_model import Deformed, displace
from experiments.analysis.registration.simulated_truth import targets_of
from experiments.inputs.surfaces import one_method
from registration import transforms
from registration.geometry.shapes import Surface
from registration.metrics.surface_distance import (
    PoseError,
    SurfaceResiduals,
    pose_error,
    rms,
    surface_residuals,
)
from registration.phantom.material_error import material_truth
from registration.pipeline import timed
from registration.rigid.result import FAILED

if TYPE_CHECKING:
    from registration.phantom.scan import SimulatedSweep
    from registration.reconstruction.contours import ContourCloud
    from registration.rigid.result import RigidResult

# Of the predicted intervals.
LEVEL = 0.9
NOT_DEFINED = float("nan")


@dataclass(frozen=True)
class StageError:
    """Error at the targets after a stage, and the 90 % intervals that the stage predicts for it.

    A target is off by the distance between where the model has it and where its tissue was swept.

    Parameters
    ----------
    tre_mm, tre_max_mm : float
        Root mean square and largest error in mm over all targets.
    tre_covered_mm, tre_uncovered_mm : float
        Root mean square over the targets that were swept and those that were not; NaN where there are none.
    predicted_mm, predicted_covered_mm, predicted_uncovered_mm : tuple of float
        Ends in mm of the interval predicted for either; NaN where none is predicted.
    """

    tre_mm: float
    tre_max_mm: float
    tre_covered_mm: float
    tre_uncovered_mm: float
    predicted_mm: tuple[float, float]
    predicted_covered_mm: tuple[float, float]
    predicted_uncovered_mm: tuple[float, float]


@dataclass(frozen=True)
class RegisteredSweep:
    """What both stages of the registration found, with their errors.

    Parameters
    ----------
    rigid : str
        Name of the rigid method.
    result : RigidResult
        Result of the rigid stage.
    residuals : SurfaceResiduals
        Residuals between the cloud and the model after it.
    pose : PoseError
        Error of the pose against the true rigid one: what no rigid pose undoes is left out.
    error : StageError
        Error after the rigid stage.
    deformed : Deformed or None
        Result of the deformable stage; None without one.
    deformed_error : StageError or None
        Error after the deformable stage; None without one.
    refusal : str
        Why there is no deformable stage although one was asked for; empty otherwise.
    """

    rigid: str
    result: RigidResult
    residuals: SurfaceResiduals
    pose: PoseError
    error: StageError
    deformed: Deformed | None
    deformed_error: StageError | None
    refusal: str


@dataclass(frozen=True)
class RegistrationStages:
    """The stages of a registration, for simulated sweeps.

    Parameters
    ----------
    rigid : Mapping[str, Any]
        Exactly one rigid registration method by its name.
    deformable : Mapping[str, Any]
        Exactly one deformable registration method by its name; None for no such method.
    fixed_points : int
        Number of points drawn from the fixed model.
    inlier_mm : float
        Distance in mm within which a point counts as explained.
    keep : float
        Share of closest distances in ``rmse_trimmed_mm``.
    seed : int
        Seed of everything that is drawn at random.
    """

    rigid: Mapping[str, Any]
    deformable: Mapping[str, Any]
    fixed_points: int
    inlier_mm: float
    keep: float
    seed: int

    def __call__(
        self, sweep: SimulatedSweep, cloud: ContourCloud, kept: np.ndarray, seconds: dict[str, float]
    ) -> RegisteredSweep:
        """Register the cloud of a sweep to the model, displace the model, and measure the errors.

        Parameters
        ----------
        sweep : SimulatedSweep
            Simulated sweep and its truth.
        cloud : ContourCloud
            Its cloud in the world frame in mm.
        kept : ndarray of int, shape (k,)
            Frames with a pose, whose masks the cloud was made of.
        seconds : dict of str to float
            Receives the seconds of the stages, as ``registration_s`` and ``deformable_s``.

        Returns
        -------
        RegisteredSweep
            Results and errors.
        """
        name, method = one_method(self.rigid)
        measures: dict[str, Any] = {"inlier_mm": self.inlier_mm, "keep": self.keep, "seed": self.seed}
        fixed_mm = sweep.model.sample(self.fixed_points, np.random.default_rng([self.seed, 1]))
        with timed(seconds, "registration_s"):
            result: RigidResult = method(cloud.points_mm, fixed_mm, None, moving_frame=cloud.frame_index)
        residuals = surface_residuals(cloud.points_mm, sweep.model, result.fixed_T_moving, **measures)
        deformed, refusal = None, ""
        second, stage = one_method(self.deformable, "deformable")
        if stage is not None and result.verdict == FAILED:
            refusal = "the rigid registration failed"
        elif stage is not None:
            swept_mm = transforms.apply(result.fixed_T_moving, cloud.points_mm)
            surfaces: dict[str, Surface] = {"fixed": sweep.model, "moving": swept_mm}
            clouds = {"fixed": fixed_mm, "moving": swept_mm}
            with timed(seconds, "deformable_s"):
                deformed, refusal = displace(
                    second, stage, "fixed", surfaces, clouds, cloud.frame_index, **measures
                )
        return self._measured(sweep, name, result, residuals, deformed, refusal, kept)

    @staticmethod
    def _measured(
        sweep: SimulatedSweep,
        name: str,
        result: RigidResult,
        residuals: SurfaceResiduals,
        deformed: Deformed | None,
        refusal: str,
        kept: np.ndarray,
    ) -> RegisteredSweep:
        truth = material_truth(sweep, targets_of(sweep), kept)
        pose, targets_mm = result.fixed_T_moving, truth.targets_mm

        def error(
            displacement_mm: np.ndarray | None, interval: Callable[..., tuple[float, float]]
        ) -> StageError:
            return _stage_error(truth.errors_mm(pose, displacement_mm), truth.covered, targets_mm, interval)

        after = None
        if deformed is not None:
            after = error(deformed.result.displacement(targets_mm), deformed.result.tre_interval_mm)
        return RegisteredSweep(
            name,
            result,
            residuals,
            pose_error(pose, truth.ct_T_world, targets_mm),
            error(None, result.tre_interval_mm),
            deformed,
            after,
            refusal,
        )


def _stage_error(
    errors_mm: np.ndarray,
    covered: np.ndarray,
    targets_mm: np.ndarray,
    interval: Callable[..., tuple[float, float]],
) -> StageError:
    parts = (np.ones_like(covered), covered, ~covered)
    tre_mm = [rms(errors_mm[part]) if part.any() else NOT_DEFINED for part in parts]
    predicted = [
        interval(targets_mm[part], LEVEL) if part.any() else (NOT_DEFINED, NOT_DEFINED) for part in parts
    ]
    return StageError(tre_mm[0], float(errors_mm.max()), tre_mm[1], tre_mm[2], *predicted)
