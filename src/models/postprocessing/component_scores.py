"""Scores of one image under many thresholds at once.

At a given ``low`` every mask that hysteresis and the removal of small components can give is a choice among
the same components. So each image is labelled once for each ``low``; the rest is arithmetic on the
components' areas, peaks and overlaps, and equals the masks' own scores exactly.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.array_types import Bool, Float, Float64, Shaped
from models.errors import InputError
from models.postprocessing.components import components
from models.postprocessing.hysteresis import peak_of, present
from models.postprocessing.morphology import ROUNDING
from models.postprocessing.options import Option


@dataclass(frozen=True, eq=False)
class SelectionCase:
    """One image of a selection group.

    Parameters
    ----------
    probability : ndarray, shape (h, w)
        Calibrated probability of vessel, 0 to 1.
    reference : ndarray of bool, shape (h, w)
        Reference mask.
    group : str
        Group of the image.
    spacing_mm : tuple of float or None, optional
        Vertical and horizontal size of a pixel in mm; None where unknown.

    Raises
    ------
    InputError
        If the sizes differ.
    """

    probability: Float[np.ndarray, "h w"]
    reference: Bool[np.ndarray, "a b"]
    group: str
    spacing_mm: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if self.probability.shape != self.reference.shape:
            raise InputError(
                f"reference: expected the probabilities' size {self.probability.shape}, "
                f"received {self.reference.shape} in group {self.group}"
            )


@dataclass(frozen=True, eq=False)
class ComponentTable:
    """Properties of the components above a threshold.

    Parameters
    ----------
    areas : ndarray, shape (n,)
        Areas in pixels.
    peaks : ndarray, shape (n,)
        Highest probabilities.
    overlaps : ndarray, shape (n,)
        Number of pixels in the reference.
    """

    areas: Float64[np.ndarray, " n"]
    peaks: Shaped[np.ndarray, " n"]
    overlaps: Float64[np.ndarray, " n"]


def component_table(case: SelectionCase, low: float, connectivity: int) -> ComponentTable:
    """Compute the properties of an image's components above a threshold.

    Parameters
    ----------
    case : SelectionCase
        The image.
    low : float
        Smallest probability of a component's pixels.
    connectivity : int
        1 for edges, 2 for edges and corners.

    Returns
    -------
    ComponentTable
        The components in the order of their first pixels, row by row.
    """
    found = components(case.probability >= low, connectivity)
    reference, probability = case.reference[found.box], case.probability[found.box]
    overlaps = np.bincount(found.labels[reference], minlength=found.count + 1)
    peaks = np.zeros(found.count + 1, dtype=probability.dtype)
    np.maximum.at(peaks, found.labels.ravel(), probability.ravel())
    return ComponentTable(found.areas[1:].astype(np.float64), peaks[1:], overlaps[1:].astype(np.float64))


class ComponentScorer:
    """Scores of a case under many options, by tables of its components.

    Parameters
    ----------
    options : sequence of Option
        Options of one connectivity; at least one.
    """

    def __init__(self, options: Sequence[Option]) -> None:
        self.connectivity = options[0].hysteresis.connectivity
        self.in_mm2 = any(option.morphology.min_area_mm2 is not None for option in options)
        self.by_low: dict[tuple[bool, float], list[int]] = {}
        for index, option in enumerate(options):
            key = (option.hysteresis.relative, option.hysteresis.low)
            self.by_low.setdefault(key, []).append(index)
        self.highs = np.array([option.hysteresis.high for option in options])
        self.min_areas = np.array([option.min_area for option in options])
        self.min_peaks = np.array([option.hysteresis.min_peak for option in options])
        self.largest_only = np.array([option.morphology.largest_only for option in options])

    def __call__(self, case: SelectionCase) -> tuple[np.ndarray | None, np.ndarray]:
        """Score a case under every option.

        Parameters
        ----------
        case : SelectionCase
            The image.

        Returns
        -------
        dsc : ndarray, shape (n,), or None
            DSC under every option; None for a case without a vessel.
        found : ndarray of bool, shape (n,)
            Whether the mask of the option has any pixel.

        Raises
        ------
        InputError
            If a probability is out of range, or a spacing is needed and unknown or not positive.
        """
        pixel_area = self._pixel_area(case)
        peak, dtype = peak_of(case.probability), case.probability.dtype
        predicted, both = np.zeros(len(self.highs)), np.zeros(len(self.highs))
        if peak > 0:
            for (relative, low), indices in self.by_low.items():
                scale = peak if relative else 1.0
                table = component_table(case, low * scale, self.connectivity)
                predicted[indices], both[indices] = self._kept(table, np.array(indices), scale, pixel_area)
        gated = np.array([not present(peak, min_peak, dtype) for min_peak in self.min_peaks])
        predicted[gated], both[gated] = 0.0, 0.0
        vessel = int(case.reference.sum())
        return (2 * both / (predicted + vessel) if vessel else None), predicted > 0

    def _kept(
        self, table: ComponentTable, indices: np.ndarray, scale: float, pixel_area: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Predicted pixels, and those of them in the reference, under the options of one low."""
        # Compared as the pixels are: in the probabilities' own type.
        highs = (self.highs[indices] * scale).astype(table.peaks.dtype)
        areas = table.areas * pixel_area
        kept = table.peaks >= highs[:, None]
        kept &= areas >= self.min_areas[indices, None] * (1 - ROUNDING)
        # The first of the largest among those kept.
        largest = np.where(kept, table.areas, 0)
        first = largest.argmax(axis=1) if table.areas.size else np.zeros(len(indices), dtype=int)
        alone = np.arange(len(table.areas)) == first[:, None]
        kept &= alone | ~self.largest_only[indices, None]
        return kept @ table.areas, kept @ table.overlaps

    def _pixel_area(self, case: SelectionCase) -> float:
        if not self.in_mm2:
            return 1.0
        if case.spacing_mm is None or not all(0 < side < math.inf for side in case.spacing_mm):
            raise InputError(
                f"spacing_mm: expected the size of a pixel for min_areas_mm2, "
                f"received {case.spacing_mm} in group {case.group}"
            )
        return case.spacing_mm[0] * case.spacing_mm[1]
