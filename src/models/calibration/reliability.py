"""Reliability tables: predicted probability against observed frequency in bins, accumulated over images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.array_types import Bool, Float, Float64, Int64, Shaped
from models.errors import InputError

# Bins of a fine table: one for each 16-bit float from 0 to a half, and as many mirrored from a half to 1.
_HALF = int(np.float16(0.5).view(np.uint16))
FINE_BINS = 2 * _HALF + 1


@dataclass(frozen=True, eq=False)
class ReliabilityTable:
    """Number of pixels and sums of probabilities and labels in bins; tables of the same bins can be added.

    Parameters
    ----------
    counts : ndarray of int, shape (bins,)
        Number of pixels.
    probability_sums : ndarray, shape (bins,)
        Sums of predicted probabilities.
    vessel_counts : ndarray of int, shape (bins,)
        Number of vessel pixels.
    """

    counts: Int64[np.ndarray, " bins"]
    probability_sums: Float64[np.ndarray, " bins"]
    vessel_counts: Int64[np.ndarray, " bins"]

    def __add__(self, other: ReliabilityTable) -> ReliabilityTable:
        if len(self.counts) != len(other.counts):
            raise InputError(
                f"bins: expected {len(self.counts)} in both tables, received {len(other.counts)}"
            )
        return ReliabilityTable(
            self.counts + other.counts,
            self.probability_sums + other.probability_sums,
            self.vessel_counts + other.vessel_counts,
        )

    @property
    def pixels(self) -> int:
        """Number of pixels in all bins."""
        return int(self.counts.sum())

    @property
    def confidence(self) -> Float64[np.ndarray, " bins"]:
        """Mean predicted probability in each bin; NaN in an empty one."""
        return _quotient(self.probability_sums, self.counts)

    @property
    def frequency(self) -> Float64[np.ndarray, " bins"]:
        """Share of vessel in each bin; NaN in an empty one."""
        return _quotient(self.vessel_counts, self.counts)

    @property
    def gaps(self) -> Float64[np.ndarray, " bins"]:
        """Absolute difference of confidence and frequency; NaN in an empty bin."""
        return np.abs(self.confidence - self.frequency)

    @property
    def expected_gap(self) -> float:
        """Mean gap over pixels: the calibration error of these bins; NaN without pixels."""
        if not self.pixels:
            return float("nan")
        return float(np.nansum(self.gaps * self.counts) / self.pixels)

    @property
    def mean_gap(self) -> float:
        """Mean gap over the bins that are not empty (MONAI's "average" calibration error)."""
        return float(np.nanmean(self.gaps)) if self.pixels else float("nan")

    @property
    def max_gap(self) -> float:
        """Largest gap (maximum calibration error)."""
        return float(np.nanmax(self.gaps)) if self.pixels else float("nan")


def equal_width_table(
    probability: Float[np.ndarray, " *any"], reference: Shaped[np.ndarray, "..."], n_bins: int
) -> ReliabilityTable:
    """Compute the table of bins of equal width; a bin includes its lower edge, the last one both edges.

    Its ``expected_gap`` is the expected calibration error, for the probability of vessel, not of the likelier
    class.

    Parameters
    ----------
    probability : ndarray
        Probabilities of vessel, 0 to 1.
    reference : ndarray
        Labels 0 and 1, of the same shape.
    n_bins : int
        Number of bins.

    Returns
    -------
    ReliabilityTable
        The table.

    Raises
    ------
    InputError
        If there is no bin, shapes differ, or probabilities or labels are out of range.

    References
    ----------
    M. P. Naeini et al., AAAI 2015; C. Guo et al., ICML 2017.
    """
    if n_bins < 1:
        raise InputError(f"n_bins: expected at least 1, received {n_bins}")
    values, labels = checked(probability, reference)
    edges = np.linspace(0.0, 1.0, n_bins + 1)
    return _table(np.searchsorted(edges[1:-1], values, side="right"), values, labels, n_bins)


def fine_table(
    probability: Float[np.ndarray, " *any"], reference: Shaped[np.ndarray, "..."]
) -> ReliabilityTable:
    """Compute the table of ``FINE_BINS`` bins as fine as 16-bit floats, towards 1 as towards 0.

    Parameters
    ----------
    probability : ndarray
        Probabilities of vessel, 0 to 1.
    reference : ndarray
        Labels 0 and 1, of the same shape.

    Returns
    -------
    ReliabilityTable
        The table, from which others are made.

    Raises
    ------
    InputError
        If shapes differ, or probabilities or labels are out of range.
    """
    values, labels = checked(probability, reference)
    below = np.minimum(values, 1 - values).astype(np.float16).view(np.uint16).astype(np.int64)
    return _table(np.where(values <= 0.5, below, 2 * _HALF - below), values, labels, FINE_BINS)


def adaptive_table(fine: ReliabilityTable, n_bins: int) -> ReliabilityTable:
    """Compute the table of bins with equal numbers of pixels.

    A fine bin is assigned as one by its middle pixel, so that equal probabilities are never separated. The
    ``expected_gap`` is the adaptive calibration error, each bin weighted by its pixels since these can't
    always be equally many.

    Parameters
    ----------
    fine : ReliabilityTable
        Result of ``fine_table``.
    n_bins : int
        Number of bins.

    Returns
    -------
    ReliabilityTable
        The table.

    Raises
    ------
    InputError
        If there is no bin.

    References
    ----------
    J. Nixon et al., CVPR Workshops 2019.
    """
    if n_bins < 1:
        raise InputError(f"n_bins: expected at least 1, received {n_bins}")
    total = fine.pixels
    # Twice the middle pixel's place, an integer; without pixels all bins are empty.
    middle = 2 * np.cumsum(fine.counts) - fine.counts
    into = np.minimum(middle * n_bins // max(2 * total, 1), n_bins - 1)
    return ReliabilityTable(
        *(
            np.bincount(into, weights=sums, minlength=n_bins).astype(sums.dtype)
            for sums in (fine.counts, fine.probability_sums, fine.vessel_counts)
        )
    )


def checked(
    probability: Float[np.ndarray, " *any"], reference: Shaped[np.ndarray, "..."]
) -> tuple[Float64[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """Check and flatten probabilities and labels.

    Parameters
    ----------
    probability : ndarray
        Probabilities of vessel.
    reference : ndarray
        Labels, of the same shape.

    Returns
    -------
    values : ndarray, shape (n,)
        Probabilities in 64 bits.
    labels : ndarray of bool, shape (n,)
        Labels.

    Raises
    ------
    InputError
        If shapes differ, probabilities are not within 0 to 1, or labels are not 0 and 1.
    """
    if probability.shape != reference.shape:
        raise InputError(
            f"reference: expected the probabilities' shape {probability.shape}, received {reference.shape}"
        )
    values = probability.reshape(-1).astype(np.float64)
    labels = reference.reshape(-1)
    if len(values) and not (values.min() >= 0 and values.max() <= 1):
        raise InputError("probability: expected 0 to 1, received other values")
    if labels.dtype != np.bool_:
        if len(labels) and not np.isin(labels, (0, 1)).all():
            raise InputError("reference: expected 0 and 1, received other values")
        labels = labels.astype(bool)
    return values, labels


def _table(
    bins: np.ndarray, values: Float64[np.ndarray, " n"], labels: Bool[np.ndarray, " n"], n_bins: int
) -> ReliabilityTable:
    return ReliabilityTable(
        np.bincount(bins, minlength=n_bins).astype(np.int64),
        np.bincount(bins, weights=values, minlength=n_bins).astype(np.float64),
        np.bincount(bins[labels], minlength=n_bins).astype(np.int64),
    )


def _quotient(sums: np.ndarray, counts: np.ndarray) -> np.ndarray:
    return np.divide(sums, counts, out=np.full(len(counts), np.nan), where=counts > 0)
