"""Candidate ways from probability to mask, among which one is selected."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.array_types import Bool, Float
from models.errors import InputError
from models.postprocessing.hysteresis import Hysteresis
from models.postprocessing.morphology import Morphology


@dataclass(frozen=True)
class Option:
    """One way from probability to mask.

    Parameters
    ----------
    hysteresis : Hysteresis
        Thresholds.
    morphology : Morphology
        Processing of the mask.
    """

    hysteresis: Hysteresis
    morphology: Morphology

    @property
    def min_area(self) -> float:
        """Smallest area of a component, in its unit."""
        return self.morphology.min_area_mm2 or self.morphology.min_area_px or 0.0

    def __call__(
        self, probability: Float[np.ndarray, "h w"], spacing_mm: tuple[float, float] | None
    ) -> Bool[np.ndarray, "h w"]:
        """Compute the mask of one image.

        Parameters
        ----------
        probability : ndarray, shape (h, w)
            Probability of vessel, 0 to 1.
        spacing_mm : tuple of float or None
            Vertical and horizontal size of a pixel in mm; None where unknown.

        Returns
        -------
        ndarray of bool, shape (h, w)
            The mask.

        Raises
        ------
        InputError
            If a probability is out of range, or the spacing is needed and unknown.
        """
        return self.morphology(self.hysteresis(probability), spacing_mm)


@dataclass(frozen=True)
class PostprocessingGrid:
    """Grid of options: all combinations in which ``low`` does not exceed ``high``.

    Parameters
    ----------
    lows, highs : sequence of float, optional
        Thresholds, above 0 and up to 1; a ``low`` without an equal ``high`` is no plain threshold.
    relative : sequence of bool, optional
        Absolute thresholds, relative ones, or both.
    min_areas_px : sequence of float, optional
        Smallest areas of components in px.
    min_areas_mm2 : sequence of float or None, optional
        Smallest areas in mm^2 instead, where every image has a spacing; None for px.
    min_peaks : sequence of float, optional
        Presence gates.
    largest_only : sequence of bool, optional
        Without, with, or both.
    connectivity : int, optional
        As in ``Hysteresis``.

    Raises
    ------
    InputError
        If a sequence is empty, no ``low`` is up to a ``high``, or a value is out of range.
    """

    lows: Sequence[float] = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
    highs: Sequence[float] = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
    relative: Sequence[bool] = (False, True)
    min_areas_px: Sequence[float] = (0.0,)
    min_areas_mm2: Sequence[float] | None = None
    min_peaks: Sequence[float] = (0.0,)
    largest_only: Sequence[bool] = (False,)
    connectivity: int = 1

    def __post_init__(self) -> None:
        for name in (
            "lows",
            "highs",
            "relative",
            "min_areas_px",
            "min_areas_mm2",
            "min_peaks",
            "largest_only",
        ):
            values = getattr(self, name)
            if values is not None and not len(values):
                raise InputError(f"{name}: expected at least one value, received none")
        if not self.options:
            raise InputError(
                f"lows, highs: expected a low up to a high, received {self.lows} and {self.highs}"
            )

    @property
    def min_areas(self) -> Sequence[float]:
        """Smallest areas in the unit that applies."""
        return self.min_areas_px if self.min_areas_mm2 is None else self.min_areas_mm2

    @property
    def options(self) -> tuple[Option, ...]:
        """All combinations, simple ones first: of equal scores the first is taken."""
        combined = itertools.product(
            sorted(set(self.relative)),
            self.lows,
            self.highs,
            self.min_areas,
            self.min_peaks,
            self.largest_only,
        )
        options = [
            Option(
                Hysteresis(low, high, relative, min_peak, self.connectivity),
                Morphology(
                    min_area_px=area if self.min_areas_mm2 is None else None,
                    min_area_mm2=None if self.min_areas_mm2 is None else area,
                    largest_only=largest,
                    connectivity=self.connectivity,
                ),
            )
            for relative, low, high, area, min_peak, largest in combined
            if low <= high
        ]
        return tuple(sorted(options, key=_complexity))


def _complexity(option: Option) -> tuple[float, ...]:
    """Plain before hysteresis, absolute before relative, no gate before a gate, near a half before far from it."""
    hysteresis = option.hysteresis
    return (
        float(hysteresis.relative),
        float(hysteresis.low < hysteresis.high),
        float(option.morphology.largest_only),
        hysteresis.min_peak,
        option.min_area,
        abs(hysteresis.high - 0.5),
        hysteresis.high - hysteresis.low,
        hysteresis.high,
    )
