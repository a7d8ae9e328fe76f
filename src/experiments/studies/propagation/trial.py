"""One sweep with some masks: their quality, the surface through them, and the registration, each against the truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.analysis.registration.simulated_truth import surface_in_ct
from models.metrics.scoring import score_case
from registration.errors import InputError as RegistrationInputError
from registration.metrics.surface_agreement import surface_agreement
from registration.metrics.surface_distance import surface_residuals
from registration.rigid.result import FAILED
from registration.synchronisation import synchronise

if TYPE_CHECKING:
    from experiments.analysis.registration.registered_sweep import RegistrationStages
    from registration.phantom.scan import SimulatedSweep
    from registration.pipeline import Gathered, Reconstruction
    from registration.sweep import PosedFrames

MASKS = ("dsc", "hd95_mm")
SURFACE = ("surface_rmse_mm", "surface_hd95_mm", "surface_hd95_covered_mm")
REGISTRATION = ("rmse_mm", "tre_mm", "deformed_tre_mm")
UNKNOWN = float("nan")


@dataclass(frozen=True)
class Trial:
    """From the masks of a sweep to the errors that they leave.

    Parameters
    ----------
    chain : Reconstruction
        From masks to the surface.
    stages : RegistrationStages
        The stages of the registration.
    max_gap_s : float
        A frame in a longer gap in s between two poses is dropped.
    samples : int
        Number of places on each surface where distances are measured.
    """

    chain: Reconstruction
    stages: RegistrationStages
    max_gap_s: float
    samples: int

    def __call__(self, truth: SimulatedSweep, values: np.ndarray) -> dict[str, Any]:
        """Measure one sweep.

        Parameters
        ----------
        truth : SimulatedSweep
            Simulated sweep and its truth.
        values : ndarray, shape (n, height, width)
            Masks of its frames, or maps whose level of one half is their outline.

        Returns
        -------
        dict
            A row: scores of the masks, errors of the surface and of the registration. What failed is infinitely far
            off, with the reason as ``surface_error`` or ``error``.
        """
        row = mask_scores(values >= self.chain.contours.level, truth)
        try:
            posed = synchronise(truth.sweep, self.max_gap_s)
            row["frames_dropped"] = sum(posed.dropped.values())
            gathered = self.chain.gather(posed.select(values), posed.world_A_pixel)
        except RegistrationInputError as refused:
            return row | self._no_surface(str(refused)) | self._no_registration(str(refused))
        return row | self._surface(truth, gathered) | self._registration(truth, posed, gathered)

    def _surface(self, truth: SimulatedSweep, gathered: Gathered) -> dict[str, Any]:
        """Distances of the surface to the vessel, with the known deformation taken out."""
        stages = self.stages
        try:
            _, material = surface_in_ct(truth, self.chain.build(gathered).surface)
            apart = surface_residuals(
                material, truth.anatomy, np.eye(4), inlier_mm=stages.inlier_mm, keep=stages.keep,
                samples=self.samples, seed=stages.seed,
            )  # fmt: skip
            both = surface_agreement(material, truth.anatomy, samples=self.samples, seed=stages.seed)
        except RegistrationInputError as refused:
            return self._no_surface(str(refused))
        return {
            "surface_rmse_mm": apart.rmse_mm,
            "surface_hd95_mm": both.hd95_mm,
            "surface_hd95_covered_mm": both.hd95_covered_mm,
            "surface_coverage": both.covered_second,
            "surface_error": "",
        }

    def _registration(self, truth: SimulatedSweep, posed: PosedFrames, gathered: Gathered) -> dict[str, Any]:
        try:
            found = self.stages(truth, gathered.cloud, posed.kept, {})
        except RegistrationInputError as refused:
            return self._no_registration(str(refused))
        if found.result.verdict == FAILED:
            return self._no_registration(found.result.reason)
        row = {
            "rmse_mm": found.residuals.rmse_mm,
            "tre_mm": found.error.tre_mm,
            "verdict": found.result.verdict,
            "error": "",
        }
        if not self._deforms:
            return row | {"deformed_tre_mm": UNKNOWN}
        if found.deformed_error is None:
            return row | {"deformed_tre_mm": np.inf, "error": found.refusal}
        return row | {"deformed_tre_mm": found.deformed_error.tre_mm}

    @property
    def _deforms(self) -> bool:
        return None not in self.stages.deformable.values()

    @staticmethod
    def _no_surface(reason: str) -> dict[str, Any]:
        return {**dict.fromkeys(SURFACE, np.inf), "surface_coverage": 0.0, "surface_error": reason}

    def _no_registration(self, reason: str) -> dict[str, Any]:
        far = dict.fromkeys(REGISTRATION, np.inf)
        if not self._deforms:
            far["deformed_tre_mm"] = UNKNOWN
        return {**far, "verdict": FAILED, "error": reason}


def mask_scores(masks: np.ndarray, truth: SimulatedSweep) -> dict[str, Any]:
    """Score the masks of a sweep frame by frame.

    Parameters
    ----------
    masks : ndarray of bool, shape (n, height, width)
        Masks of all frames.
    truth : SimulatedSweep
        Simulated sweep and its truth.

    Returns
    -------
    dict
        ``dsc`` and ``hd95_mm``: means over the ``frames`` that show the vessel, in which a missed vessel scores 0 and
        the image's diagonal; ``missed``: how many of them have an empty mask; ``frames_empty``: how many frames show
        no vessel; ``false_alarms``: how many of those have a mask.
    """
    spacing_mm = truth.sweep.calibration.spacing_mm
    scores = [score_case(mask, exact, spacing_mm) for mask, exact in zip(masks, truth.masks, strict=True)]
    seen = [score for score in scores if not np.isnan(score.dsc)]
    empty = [score for score in scores if np.isnan(score.dsc)]
    found = {
        name: float(np.mean([getattr(one, name) for one in seen])) if seen else UNKNOWN for name in MASKS
    }
    return {
        **found,
        "frames": len(seen),
        "missed": int(sum(score.missed for score in seen)),
        "frames_empty": len(empty),
        "false_alarms": int(sum(score.false_alarm for score in empty)),
    }
