"""Measures of calibration: NLL, Brier score, ECE and ACE, of all pixels and near the vessel's boundary."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt

from models.array_types import Bool, Float, Shaped
from models.calibration.reliability import (
    ReliabilityTable,
    adaptive_table,
    checked,
    equal_width_table,
    fine_table,
)
from models.calibration.temperature import MIN_PROBABILITY
from models.errors import InputError

N_BINS = 15


@dataclass(frozen=True, eq=False)
class PixelStatistics:
    """Sums over pixels from which all scores follow; those of several images can be added.

    Parameters
    ----------
    nll_sum, brier_sum : float
        Sums of the pixels' negative log-likelihoods and squared differences of probability and label.
    equal_width, fine : ReliabilityTable
        Tables of bins of equal width and of fine ones.
    """

    nll_sum: float
    brier_sum: float
    equal_width: ReliabilityTable
    fine: ReliabilityTable

    @classmethod
    def of(
        cls,
        probability: Float[np.ndarray, "*any"],
        reference: Shaped[np.ndarray, "..."],
        n_bins: int = N_BINS,
    ) -> PixelStatistics:
        """Compute the statistics of probabilities.

        Parameters
        ----------
        probability : ndarray
            Probabilities of vessel, 0 to 1.
        reference : ndarray
            Labels 0 and 1, of the same shape.
        n_bins : int, optional
            Number of bins of equal width.

        Returns
        -------
        PixelStatistics
            The statistics.

        Raises
        ------
        InputError
            If shapes differ, or probabilities or labels are out of range.
        """
        values, labels = checked(probability, reference)
        of_label = np.where(labels, values, 1 - values)
        nll = -np.log(np.maximum(of_label, MIN_PROBABILITY))
        return cls(
            float(nll.sum()),
            float(((1 - of_label) ** 2).sum()),
            equal_width_table(values, labels, n_bins),
            fine_table(values, labels),
        )

    def __add__(self, other: PixelStatistics) -> PixelStatistics:
        return PixelStatistics(
            self.nll_sum + other.nll_sum,
            self.brier_sum + other.brier_sum,
            self.equal_width + other.equal_width,
            self.fine + other.fine,
        )

    @property
    def pixels(self) -> int:
        """Number of pixels."""
        return self.equal_width.pixels

    @property
    def nll(self) -> float:
        """Mean negative log-likelihood; NaN without pixels.

        A probability of 0 for what is there counts as ``MIN_PROBABILITY``: in 32 bits it means no less.
        """
        return self.nll_sum / self.pixels if self.pixels else float("nan")

    @property
    def brier(self) -> float:
        """Mean squared difference of probability and label (Brier, Monthly Weather Review 78(1), 1950)."""
        return self.brier_sum / self.pixels if self.pixels else float("nan")

    @property
    def ece(self) -> float:
        """Expected calibration error over bins of equal width."""
        return self.equal_width.expected_gap

    @property
    def ace(self) -> float:
        """Adaptive calibration error over as many bins of equally many pixels."""
        return adaptive_table(self.fine, len(self.equal_width.counts)).expected_gap


@dataclass(frozen=True)
class CalibrationScores:
    """Calibration scores of a set of images; NaN where they have no pixels (a band without a boundary).

    Parameters
    ----------
    nll : float
        Mean negative log-likelihood.
    brier : float
        Brier score.
    ece, ace : float
        Expected and adaptive calibration error.
    ece_boundary : float
        Expected calibration error of the pixels near the reference's boundary.
    pixels, pixels_boundary : int
        Number of all pixels and of those near the boundary.
    """

    nll: float
    brier: float
    ece: float
    ace: float
    ece_boundary: float
    pixels: int
    pixels_boundary: int


@dataclass(frozen=True, eq=False)
class CalibrationStatistics:
    """Statistics of all pixels and of those near the boundary; those of several images can be added.

    Parameters
    ----------
    everywhere : PixelStatistics
        Statistics of all pixels.
    boundary : PixelStatistics
        Statistics of the pixels near the boundary.
    """

    everywhere: PixelStatistics
    boundary: PixelStatistics

    @classmethod
    def of(
        cls,
        probability: Float[np.ndarray, "h w"],
        reference: Shaped[np.ndarray, "..."],
        *,
        band_px: float,
        n_bins: int = N_BINS,
    ) -> CalibrationStatistics:
        """Compute the statistics of one image.

        Parameters
        ----------
        probability : ndarray, shape (h, w)
            Probabilities of vessel, 0 to 1.
        reference : ndarray, shape (h, w)
            Labels 0 and 1.
        band_px : float
            Half width of the band around the boundary in px, as in ``boundary_band``.
        n_bins : int, optional
            Number of bins of equal width.

        Returns
        -------
        CalibrationStatistics
            The statistics.

        Raises
        ------
        InputError
            If shapes differ, probabilities or labels are out of range, or the band is narrower than 1 px.
        """
        everywhere = PixelStatistics.of(probability, reference, n_bins)
        band = boundary_band(reference, band_px)
        return cls(
            everywhere,
            PixelStatistics.of(probability[band], reference[band], n_bins),
        )

    def __add__(self, other: CalibrationStatistics) -> CalibrationStatistics:
        return CalibrationStatistics(self.everywhere + other.everywhere, self.boundary + other.boundary)

    @property
    def scores(self) -> CalibrationScores:
        """The scores of these statistics."""
        return CalibrationScores(
            self.everywhere.nll,
            self.everywhere.brier,
            self.everywhere.ece,
            self.everywhere.ace,
            self.boundary.ece,
            self.everywhere.pixels,
            self.boundary.pixels,
        )


def calibration_statistics(
    images: Iterable[tuple[np.ndarray, np.ndarray]], *, band_px: float, n_bins: int = N_BINS
) -> CalibrationStatistics:
    """Compute the statistics of a stream of images of any sizes, in constant memory.

    Parameters
    ----------
    images : iterable of tuple of ndarray
        Probabilities and references, both of shape (h, w).
    band_px : float
        Half width of the band around the boundary in px, as in ``boundary_band``.
    n_bins : int, optional
        Number of bins of equal width.

    Returns
    -------
    CalibrationStatistics
        The sum of the images' statistics.

    Raises
    ------
    InputError
        If there is no image, or one is not as ``CalibrationStatistics.of`` expects.
    """
    total: CalibrationStatistics | None = None
    for probability, reference in images:
        one = CalibrationStatistics.of(probability, reference, band_px=band_px, n_bins=n_bins)
        total = one if total is None else total + one
    if total is None:
        raise InputError("images: expected probabilities and references, received none")
    return total


def boundary_band(reference: Shaped[np.ndarray, "h w"], width_px: float) -> Bool[np.ndarray, "h w"]:
    """Find the pixels on either side of a mask's boundary, by their distance from the other side.

    The image border is no boundary: nothing is known beyond it.

    Parameters
    ----------
    reference : ndarray, shape (h, w)
        Mask.
    width_px : float
        Largest distance in px from a pixel of the other class, at least 1; with 1 the pixels that share an
        edge with one.

    Returns
    -------
    ndarray of bool, shape (h, w)
        The band; empty where the mask has one class only.

    Raises
    ------
    InputError
        If the width is below 1 or infinite.

    Examples
    --------
    >>> boundary_band(np.array([[0, 0, 0, 1, 1, 1]], bool), 1.0).astype(int)
    array([[0, 0, 1, 1, 0, 0]])
    """
    if not 1 <= width_px < math.inf:
        raise InputError(f"band_px: expected a number of pixels from 1, received {width_px}")
    mask = np.asarray(reference).astype(bool)
    band = np.zeros(mask.shape, dtype=bool)
    if mask.all() or not mask.any():
        return band
    # Farther from the mask than the width there is no band.
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    margin = math.ceil(width_px) + 1
    box = tuple(slice(max(int(at[0]) - margin, 0), int(at[-1]) + margin + 1) for at in (rows, columns))
    part = mask[box]
    band[box] = np.where(part, distance_transform_edt(part), distance_transform_edt(~part)) <= width_px
    return band
