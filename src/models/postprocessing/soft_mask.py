"""A probability map moved so that its level of one half is the outline of the final mask."""

from __future__ import annotations

import numpy as np

from models.array_types import Bool, Float32
from models.postprocessing.options import Option

_BELOW_HALF = np.nextafter(np.float32(0.5), np.float32(0.0))


def soft_mask(
    probability: Float32[np.ndarray, "h w"], mask: Bool[np.ndarray, "h w"], option: Option
) -> Float32[np.ndarray, "h w"]:
    """Map probabilities so that they are one half or more exactly in the mask.

    Outlines of sub-pixel accuracy are taken at a level of one half. The lower threshold of the option is mapped to one
    half, linearly on both sides; what thresholds and morphology removed becomes 0, and what they filled 1.

    Parameters
    ----------
    probability : ndarray of float32, shape (h, w)
        Probability of vessel, 0 to 1.
    mask : ndarray of bool, shape (h, w)
        Mask that ``option`` made of it, or an empty one.
    option : Option
        From probability to mask.

    Returns
    -------
    ndarray of float32, shape (h, w)
        Values 0 to 1; the probability itself for a plain threshold of one half.
    """
    low = option.hysteresis.low
    if option.hysteresis.relative:
        low *= float(probability.max())
    if low == 0:
        return np.zeros(probability.shape, dtype=np.float32)
    above = probability >= low
    if low == 0.5:  # both sides keep their values, exactly
        return _corrected(probability, above, mask)
    upper = 0.5 + 0.5 * (probability - low) / (1 - low) if low < 1 else np.ones_like(probability)
    values = np.where(above, np.maximum(upper, 0.5), np.minimum(0.5 * probability / low, _BELOW_HALF))
    return _corrected(np.asarray(values, dtype=np.float32), above, mask)


def _corrected(
    values: Float32[np.ndarray, "h w"], above: Bool[np.ndarray, "h w"], mask: Bool[np.ndarray, "h w"]
) -> Float32[np.ndarray, "h w"]:
    """Values with 0 and 1 where thresholds and morphology removed or filled; themselves where they did neither."""
    if np.array_equal(above, mask):
        return values
    return np.where(above == mask, values, mask.astype(np.float32))
