"""The chain from frames to the displaced model, once, with what each stage took."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.analysis.registration.simulated_truth import targets_of
from experiments.errors import InputError
from experiments.studies.runtime.costs import Cost, measured
from registration import transforms
from registration.errors import InputError as RegistrationInputError
from registration.metrics.surface_distance import pose_error
from registration.rigid.result import FAILED
from registration.synchronisation import synchronise

if TYPE_CHECKING:
    from models.predictor import Predictor
    from registration.centerline.extractor import CenterlineExtractor
    from registration.cpd import CoherentPointDrift
    from registration.geometry.shapes import Mesh
    from registration.phantom.scan import SimulatedSweep
    from registration.pipeline import Gathered, Reconstruction
    from registration.reconstruction.contours import ContourCloud
    from registration.rigid.result import RigidResult

ACQUISITION, PREPROCESSING, SEGMENTATION = "acquisition", "preprocessing", "segmentation"
RECONSTRUCTION, CENTERLINE = "reconstruction", "centerline"
RIGID, DEFORMABLE = "rigid", "deformable"
STAGES = (ACQUISITION, PREPROCESSING, SEGMENTATION, RECONSTRUCTION, CENTERLINE, RIGID, DEFORMABLE)
UNKNOWN = float("nan")


@dataclass(frozen=True)
class TimedRun:
    """One run through the chain.

    Parameters
    ----------
    costs : tuple of Cost
        What each stage took, in order.
    tre_mm : float
        Target registration error in mm of the rigid pose: whether what was timed did its work.
    """

    costs: tuple[Cost, ...]
    tre_mm: float


@dataclass(frozen=True)
class Chain:
    """All stages with their settings.

    Parameters
    ----------
    predictor : Predictor or None
        Segments the frames; None takes the exact masks and leaves out the stages ``preprocessing`` and
        ``segmentation``.
    reconstruction : Reconstruction
        From masks to the surface, without the centerline, which is a stage of its own.
    centerline : CenterlineExtractor
        Extraction of the centerline.
    rigid : callable
        Rigid registration method.
    deformable : CoherentPointDrift or None
        Deformable registration method; None leaves the stage out.
    frame_rate_hz : float or None
        Frame rate of the modelled acquisition in frames/s; None takes that of the sweep.
    max_gap_s : float
        A frame in a longer gap in s between two poses is dropped.
    fixed_points : int
        Number of points drawn from the fixed model.
    seed : int
        Seed of that draw and of the registration.
    """

    predictor: Predictor | None
    reconstruction: Reconstruction
    centerline: CenterlineExtractor
    rigid: Any
    deformable: CoherentPointDrift | None
    frame_rate_hz: float | None
    max_gap_s: float
    fixed_points: int
    seed: int

    def __call__(self, truth: SimulatedSweep) -> TimedRun:
        """Run all stages on a sweep.

        Parameters
        ----------
        truth : SimulatedSweep
            Simulated sweep and its truth.

        Returns
        -------
        TimedRun
            What each stage took. A stage after the cloud that fails has no time and says why.

        Raises
        ------
        InputError
            If no frame shows a vessel.
        """
        # The model from CT is made and sampled before the intervention.
        fixed_mm = truth.model.sample(self.fixed_points, np.random.default_rng([self.seed, 1]))
        costs = [self._acquisition(truth)]
        values = truth.masks if self.predictor is None else segmented(self.predictor, truth, costs)
        gathered, surface = self._reconstructed(truth, values, costs)
        if surface is not None:
            self._centerline(surface, costs)
        cloud = gathered.cloud
        with measured(costs, RIGID):
            result: RigidResult = self.rigid(cloud.points_mm, fixed_mm, None, moving_frame=cloud.frame_index)
        if self.deformable is not None:
            self._deform(fixed_mm, cloud, result, costs)
        error = pose_error(result.fixed_T_moving, truth.ct_T_world, targets_of(truth))
        return TimedRun(tuple(costs), float(error.tre_mm))

    def _acquisition(self, truth: SimulatedSweep) -> Cost:
        rate_hz = self.frame_rate_hz or rate_of(truth.sweep.image_times_s)
        return Cost(ACQUISITION, len(truth.sweep.image_times_s) / rate_hz, UNKNOWN, modelled=True)

    def _reconstructed(
        self, truth: SimulatedSweep, values: np.ndarray, costs: list[Cost]
    ) -> tuple[Gathered, Mesh | None]:
        refusal, surface = "", None
        with measured(costs, RECONSTRUCTION):
            posed = synchronise(truth.sweep, self.max_gap_s)
            shown = posed.select(values)
            if not (shown >= self.reconstruction.contours.level).any():
                raise InputError("masks: expected a vessel in some frames, received none in any")
            gathered = self.reconstruction.gather(shown, posed.world_A_pixel)
            try:
                surface = self.reconstruction.build(gathered).surface
            except RegistrationInputError as refused:
                refusal = str(refused)
        _note_failure(costs, refusal)
        return gathered, surface

    def _centerline(self, surface: Mesh, costs: list[Cost]) -> None:
        refusal = ""
        with measured(costs, CENTERLINE):
            try:
                self.centerline(surface)
            except RegistrationInputError as refused:
                refusal = str(refused)
        _note_failure(costs, refusal)

    def _deform(
        self, fixed_mm: np.ndarray, cloud: ContourCloud, rigid: RigidResult, costs: list[Cost]
    ) -> None:
        assert self.deformable is not None
        if rigid.verdict == FAILED:
            costs.append(Cost(DEFORMABLE, UNKNOWN, UNKNOWN, error="the rigid registration failed"))
            return
        refusal = ""
        with measured(costs, DEFORMABLE):
            # The model is displaced to where the sweep, brought to the model's frame, has seen it.
            swept_mm = transforms.apply(rigid.fixed_T_moving, cloud.points_mm)
            try:
                self.deformable(fixed_mm, swept_mm, fixed_frame=cloud.frame_index, seed=self.seed)
            except RegistrationInputError as refused:
                refusal = str(refused)
        _note_failure(costs, refusal)


def segmented(predictor: Predictor, truth: SimulatedSweep, costs: list[Cost]) -> np.ndarray:
    """Segment the frames; pre-processing and the rest alternate batch by batch and share one peak of memory.

    Parameters
    ----------
    predictor : Predictor
        The model in use.
    truth : SimulatedSweep
        Simulated sweep.
    costs : list of Cost
        Gets the costs of pre-processing and of the rest.

    Returns
    -------
    ndarray of float32, shape (n, height, width)
        Maps whose level of one half is the outline of the masks.
    """
    from models.inference.frames import frames_of

    images, spacing_mm = truth.sweep.images, truth.sweep.calibration.spacing_mm
    both: list[Cost] = []
    preprocessing_s, found = 0.0, np.empty(images.shape[:3], dtype=np.float32)
    with measured(both, SEGMENTATION):
        for place, each in enumerate(predictor.stream(frames_of(images, spacing_mm))):
            found[place] = each.soft_mask
            preprocessing_s += each.times.preprocessing_s
    rest = replace(both[0], seconds=both[0].seconds - preprocessing_s)
    costs += [replace(both[0], stage=PREPROCESSING, seconds=preprocessing_s), rest]
    return found


def rate_of(times_s: Sequence[float] | np.ndarray) -> float:
    """Compute the frame rate of a sweep.

    Parameters
    ----------
    times_s : array_like, shape (n,)
        Time of each frame in s.

    Returns
    -------
    float
        Frames/s.

    Raises
    ------
    InputError
        If there are fewer than two frames or no time between them.
    """
    spent_s = float(times_s[-1] - times_s[0]) if len(times_s) > 1 else 0.0
    if not spent_s > 0:
        raise InputError(f"frame_rate_hz: expected a sweep with a frame rate, received {len(times_s)} frames")
    return (len(times_s) - 1) / spent_s


def _note_failure(costs: list[Cost], refusal: str) -> None:
    """Take the time of the last stage away if it failed: it did not do what it is timed for."""
    if refusal:
        costs[-1] = replace(costs[-1], seconds=UNKNOWN, peak_memory_mb=UNKNOWN, error=refusal)
