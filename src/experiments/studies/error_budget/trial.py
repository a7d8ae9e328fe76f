"""One registration with some sources of error on: a row with the quality of the masks and the error of each stage."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.analysis.registration.registered_sweep import RegistrationStages
from registration.errors import InputError as RegistrationInputError
from registration.phantom.error_sources import ErrorSources, shifted_borders
from registration.phantom.scan import simulate_sweep
from registration.pipeline import CloudFilter, gather
from registration.rigid.result import FAILED
from registration.synchronisation import synchronise

if TYPE_CHECKING:
    from registration.phantom.scan import SimulatedSweep
    from registration.phantom.settings import PhantomSettings
    from registration.reconstruction.contours import ContourExtractor
    from registration.reconstruction.mask_outliers import MaskOutliers

# Kinds of rows: some sources on, or masks of a given quality and no other error.
SUBSET, MASKS = "sources", "masks"
SEPARATOR = "+"


@dataclass(frozen=True)
class Trials:
    """Registrations of one sweep of a phantom under errors.

    Parameters
    ----------
    phantom : PhantomSettings
        Settings of the phantom.
    sweep : int
        Number of the sweep.
    sources : ErrorSources
        Size of each source.
    contours : ContourExtractor
        Extraction of contours from the masks.
    filters : Mapping[str, CloudFilter]
        Filters of the point cloud by name, in order of use.
    mask_outliers : MaskOutliers
        Test that rejects masks that disagree with their neighbours.
    stages : RegistrationStages
        The stages of the registration.
    max_gap_s : float
        A frame in a longer gap in s between two poses is dropped.
    seed : int
        Seed of the errors of masks.
    """

    phantom: PhantomSettings
    sweep: int
    sources: ErrorSources
    contours: ContourExtractor
    filters: Mapping[str, CloudFilter]
    mask_outliers: MaskOutliers
    stages: RegistrationStages
    max_gap_s: float
    seed: int

    def with_sources(self, on: frozenset[str], order: Sequence[str]) -> dict[str, Any]:
        """Register with some sources on.

        Parameters
        ----------
        on : frozenset of str
            Sources that are on.
        order : sequence of str
            All sources, in the order in which a row names them.

        Returns
        -------
        dict
            The row.
        """
        sweep = self._swept(on)
        spacing_mm = sweep.sweep.calibration.spacing_mm
        masks = self.sources.masks_with(sweep.masks, on, spacing_mm, self._rng())
        names = SEPARATOR.join(source for source in order if source in on)
        return {"kind": SUBSET, "on": names, "bias_mm": 0.0, "deviation_mm": 0.0} | self._row(sweep, masks)

    def with_masks(self, bias_mm: float, deviation_mm: float) -> dict[str, Any]:
        """Register with masks of a given quality, and no other source on.

        Parameters
        ----------
        bias_mm : float
            By how far every border lies outside in mm.
        deviation_mm : float
            Standard deviation in mm of a shift that varies along the borders.

        Returns
        -------
        dict
            The row.
        """
        sweep = self._swept(frozenset())
        spacing_mm = sweep.sweep.calibration.spacing_mm
        masks = shifted_borders(sweep.masks, bias_mm, deviation_mm, spacing_mm, self._rng())
        about = {"kind": MASKS, "on": "", "bias_mm": bias_mm, "deviation_mm": deviation_mm}
        return about | self._row(sweep, masks)

    def _swept(self, on: frozenset[str]) -> SimulatedSweep:
        return simulate_sweep(self.sources.settings_with(self.phantom, on), self.sweep, pictures=False)

    def _rng(self) -> np.random.Generator:
        return np.random.default_rng([self.seed, 3, self.sweep])

    def _row(self, sweep: SimulatedSweep, masks: np.ndarray) -> dict[str, Any]:
        far = {"rmse_mm": np.inf, "tre_mm": np.inf, "deformed_tre_mm": np.inf}
        row: dict[str, Any] = {"dsc": _dsc(masks, sweep.masks), "error": ""}
        posed = synchronise(sweep.sweep, self.max_gap_s)
        try:
            gathered = gather(
                masks[posed.kept], posed.world_A_pixel, self.contours, self.filters, self.mask_outliers
            )
            registered = self.stages(sweep, gathered.cloud, posed.kept, {})
        except RegistrationInputError as refused:
            return row | far | {"error": str(refused)}
        if registered.result.verdict == FAILED:
            return row | far | {"error": registered.result.reason}
        row |= {"rmse_mm": registered.residuals.rmse_mm, "tre_mm": registered.error.tre_mm}
        if None in self.stages.deformable.values():
            return row | {"deformed_tre_mm": np.nan}
        if registered.deformed_error is None:
            return row | {"deformed_tre_mm": np.inf, "error": registered.refusal}
        return row | {"deformed_tre_mm": registered.deformed_error.tre_mm}


def _dsc(masks: np.ndarray, exact: np.ndarray) -> float:
    """Mean DSC over the frames that show the vessel."""
    seen = exact.any(axis=(1, 2))
    if not seen.any():
        return float("nan")
    common = (masks & exact)[seen].sum(axis=(1, 2))
    return float((2.0 * common / (masks[seen].sum(axis=(1, 2)) + exact[seen].sum(axis=(1, 2)))).mean())
