"""How well a vessel mask agrees with its reference: overlap, boundary distance, misses and false alarms.

Distances are taken at the masks' own resolution; spacing is (vertical, horizontal) in mm, or one number for square
pixels. An undefined value is NaN, a boundary that is not there infinitely far away, never a plausible number.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from models.array_types import Bool, Float64, Shaped
from models.errors import InputError
from models.metrics.boundaries import (
    Boundary,
    boundary_elements,
    boundary_pixels,
    crop_to_union,
    distances_between,
)

Spacing = float | Sequence[float] | np.ndarray


def dsc(prediction: Shaped[np.ndarray, "_ _"], reference: Shaped[np.ndarray, "_ _"]) -> float:
    """Compute the Dice similarity coefficient of two masks, 2 |P and R| / (|P| + |R|).

    Parameters
    ----------
    prediction, reference : ndarray of bool or of 0 and 1, shape (h, w)
        Masks of one size.

    Returns
    -------
    float
        0 to 1; NaN if both masks are empty.

    Raises
    ------
    InputError
        If sizes differ or a mask has other values.

    References
    ----------
    L. R. Dice, Ecology 26(3), 1945.

    Examples
    --------
    >>> dsc(np.array([[True, True, False]]), np.array([[False, True, True]]))
    0.5
    """
    prediction, reference = _masks(prediction, reference)
    pixels = int(np.count_nonzero(prediction)) + int(np.count_nonzero(reference))
    return 2 * int(np.count_nonzero(prediction & reference)) / pixels if pixels else float("nan")


def hd95_mm(
    prediction: Shaped[np.ndarray, "_ _"], reference: Shaped[np.ndarray, "_ _"], spacing_mm: Spacing
) -> float:
    """Compute the larger of the two directed 95th percentiles of the distance between boundary pixels, in mm.

    A boundary pixel has a background pixel, or the image's border, on one of its four sides; percentiles interpolate
    linearly.

    Parameters
    ----------
    prediction, reference : ndarray of bool or of 0 and 1, shape (h, w)
        Masks of one size.
    spacing_mm : float or sequence of two floats
        Size of a pixel in mm, vertical before horizontal.

    Returns
    -------
    float
        Distance in mm; infinite if one mask is empty, NaN if both are.

    Raises
    ------
    InputError
        If sizes differ, a mask has other values, or the spacing is not positive.

    References
    ----------
    D. P. Huttenlocher et al., IEEE TPAMI 15(9), 1993.

    Examples
    --------
    >>> hd95_mm(np.array([[False, False, True]]), np.array([[True, False, False]]), (1.0, 0.5))
    1.0
    """
    first, second = _directed(prediction, reference, _spacing(spacing_mm), boundary_pixels)
    return max(_percentile(first[0]), _percentile(second[0])) if _any(first, second) else float("nan")


def hd95_px(prediction: Shaped[np.ndarray, "_ _"], reference: Shaped[np.ndarray, "_ _"]) -> float:
    """Compute ``hd95_mm`` in pixels, for images whose spacing is not known.

    Parameters
    ----------
    prediction, reference : ndarray of bool or of 0 and 1, shape (h, w)
        Masks of one size.

    Returns
    -------
    float
        Distance in px; infinite if one mask is empty, NaN if both are.
    """
    return hd95_mm(prediction, reference, 1.0)


def hd95_pooled_mm(
    prediction: Shaped[np.ndarray, "_ _"], reference: Shaped[np.ndarray, "_ _"], spacing_mm: Spacing
) -> float:
    """Compute the 95th percentile over the distances of both directions together, in mm.

    Parameters
    ----------
    prediction, reference : ndarray of bool or of 0 and 1, shape (h, w)
        Masks of one size.
    spacing_mm : float or sequence of two floats
        Size of a pixel in mm, vertical before horizontal.

    Returns
    -------
    float
        Distance in mm; empty masks as in ``hd95_mm``.
    """
    first, second = _directed(prediction, reference, _spacing(spacing_mm), boundary_pixels)
    if not _any(first, second):
        return float("nan")
    return _percentile(np.concatenate([first[0], second[0]]))


def hd95_surfel_mm(
    prediction: Shaped[np.ndarray, "_ _"], reference: Shaped[np.ndarray, "_ _"], spacing_mm: Spacing
) -> float:
    """Compute the larger of the directed 95th percentiles, each contour element weighted by its length, in mm.

    Equals the robust Hausdorff distance of surface-distance.

    Parameters
    ----------
    prediction, reference : ndarray of bool or of 0 and 1, shape (h, w)
        Masks of one size.
    spacing_mm : float or sequence of two floats
        Size of a pixel in mm, vertical before horizontal.

    Returns
    -------
    float
        Distance in mm; empty masks as in ``hd95_mm``.

    References
    ----------
    S. Nikolov et al., J. Med. Internet Res. 23(7), 2021.
    """
    first, second = _directed(prediction, reference, _spacing(spacing_mm), boundary_elements)
    return (
        max(_percentile_of_length(*first), _percentile_of_length(*second)) if _any(first, second) else np.nan
    )


def diagonal(shape: tuple[int, ...], spacing: Spacing) -> float:
    """Compute the length of an image's diagonal: the distance that a missed vessel is scored with.

    Parameters
    ----------
    shape : tuple of int
        Height and width in px.
    spacing : float or sequence of two floats
        Size of a pixel, vertical before horizontal.

    Returns
    -------
    float
        Length in the unit of ``spacing``.
    """
    vertical, horizontal = _spacing(spacing)
    return float(np.hypot(shape[0] * vertical, shape[1] * horizontal))


Directed = tuple[np.ndarray, np.ndarray]  # distances from each boundary point, contour lengths they stand for


def _directed(
    prediction: np.ndarray,
    reference: np.ndarray,
    spacing: tuple[float, float],
    boundary_of: Callable[..., Boundary],
) -> tuple[Directed, Directed]:
    """Distances and contour lengths from the prediction's boundary to the reference's, and back."""
    cropped = crop_to_union(*_masks(prediction, reference))
    first, second = (boundary_of(mask, spacing) for mask in cropped)
    there, back = distances_between(first, second)
    return (there, first.lengths), (back, second.lengths)


def _any(first: Directed, second: Directed) -> bool:
    return len(first[0]) + len(second[0]) > 0


def _percentile(distances: Float64[np.ndarray, " n"]) -> float:
    # An empty mask has no distances of its own: the other direction's are infinite and decide.
    return float(np.quantile(distances, 0.95)) if len(distances) and np.isfinite(distances[0]) else np.inf


def _percentile_of_length(distances: Float64[np.ndarray, " n"], lengths: Float64[np.ndarray, " n"]) -> float:
    """The smallest distance within which 95 % of the contour's length lies."""
    if not len(distances):
        return float("inf")
    order = np.lexsort((lengths, distances))
    share = np.cumsum(lengths[order]) / lengths[order].sum()
    return float(distances[order][min(int(np.searchsorted(share, 0.95)), len(order) - 1)])


def _masks(prediction: np.ndarray, reference: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    if prediction.shape != reference.shape:
        raise InputError(
            f"prediction: expected the reference's size {reference.shape}, received {prediction.shape}"
        )
    return _mask(prediction, "prediction"), _mask(reference, "reference")


def _mask(mask: np.ndarray, name: str) -> Bool[np.ndarray, "h w"]:
    if mask.ndim != 2 or mask.size == 0:
        raise InputError(f"{name}: expected a mask of shape (height, width), received {mask.shape}")
    if mask.dtype == np.bool_:
        return mask
    if not np.issubdtype(mask.dtype, np.integer) or mask.min() < 0 or mask.max() > 1:
        raise InputError(
            f"{name}: expected bool or integers 0 and 1, received {mask.dtype} with other values"
        )
    return mask.astype(bool)


def _spacing(spacing: Spacing) -> tuple[float, float]:
    sides = np.atleast_1d(np.asarray(spacing, dtype=np.float64))
    if sides.size not in (1, 2) or not (np.isfinite(sides).all() and (sides > 0).all()):
        raise InputError(
            f"spacing_mm: expected one or two positive numbers (vertical, horizontal), received {spacing}"
        )
    return float(sides[0]), float(sides[-1])
