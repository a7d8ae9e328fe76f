"""Hysteresis thresholding of probability maps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.array_types import Bool, Float
from models.errors import InputError
from models.postprocessing.components import components, require_connectivity


@dataclass(frozen=True)
class Hysteresis:
    """Hysteresis threshold: pixels from probability ``low`` on, connected with one from ``high`` on.

    With ``low`` equal to ``high`` it is a plain threshold.

    Parameters
    ----------
    low, high : float, optional
        Probabilities, above 0 and up to 1, ``low`` not above ``high``; shares of the image's own highest
        probability with ``relative``.
    relative : bool, optional
        Whether thresholds are relative to each image's highest probability.
    min_peak : float, optional
        Presence gate: an image whose highest probability is below this (0 to 1) has an empty mask.
    connectivity : int, optional
        1: pixels that share an edge are connected; 2: those that share a corner too.

    Raises
    ------
    InputError
        If a parameter is out of range.

    References
    ----------
    J. Canny, IEEE TPAMI 8(6), 1986.
    """

    low: float = 0.5
    high: float = 0.5
    relative: bool = False
    min_peak: float = 0.0
    connectivity: int = 1

    def __post_init__(self) -> None:
        if not 0 < self.low <= self.high <= 1:
            raise InputError(f"low, high: expected 0 < low <= high <= 1, received {self.low} and {self.high}")
        if not 0 <= self.min_peak <= 1:
            raise InputError(f"min_peak: expected 0 to 1, received {self.min_peak}")
        require_connectivity(self.connectivity)

    def __call__(self, probability: Float[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
        """Compute the mask of one image.

        Parameters
        ----------
        probability : ndarray, shape (h, w)
            Probability of vessel, 0 to 1.

        Returns
        -------
        ndarray of bool, shape (h, w)
            The mask.

        Raises
        ------
        InputError
            If a probability is NaN or out of range.
        """
        peak = peak_of(probability)
        if not present(peak, self.min_peak, probability.dtype):
            return np.zeros(probability.shape, dtype=bool)
        scale = peak if self.relative else 1.0
        low, high = self.low * scale, self.high * scale
        candidates = probability >= low
        if high <= low or not candidates.any():
            return np.asarray(candidates)
        found = components(candidates, self.connectivity)
        kept = np.zeros(found.count + 1, dtype=bool)
        kept[found.labels[probability[found.box] >= high]] = True
        kept[0] = False
        mask = np.zeros(probability.shape, dtype=bool)
        mask[found.box] = kept[found.labels]
        return mask


def present(peak: float, min_peak: float, dtype: np.dtype) -> bool:
    """Decide whether an image passes the presence gate.

    Parameters
    ----------
    peak : float
        Highest probability of the image.
    min_peak : float
        Smallest peak that passes.
    dtype : numpy.dtype
        Type of the probabilities, in which they are compared.

    Returns
    -------
    bool
        Whether the peak is above 0 and not below ``min_peak``.
    """
    return bool(peak > 0 and peak >= dtype.type(min_peak))


def peak_of(probability: Float[np.ndarray, "h w"]) -> float:
    """Find the highest probability of an image.

    Parameters
    ----------
    probability : ndarray, shape (h, w)
        Probability of vessel.

    Returns
    -------
    float
        The highest.

    Raises
    ------
    InputError
        If a value is NaN or not within 0 to 1.
    """
    lowest, highest = float(probability.min()), float(probability.max())
    if not (lowest >= 0 and highest <= 1):
        raise InputError(f"probability: expected 0 to 1, received {lowest:g} to {highest:g}")
    return highest
