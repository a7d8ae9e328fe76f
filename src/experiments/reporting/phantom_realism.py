"""Measures that compare simulated images with real ones: contrast, grain, and how easy the vessel is to find."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float64, UInt8
from scipy.ndimage import binary_dilation, binary_erosion, gaussian_filter, label

from registration.errors import InputError

PATCH_PX = 48
# Structure wider than this is taken out of a patch before its grain is measured.
BACKGROUND_PX = 12.0
MIN_VESSEL_PX = 300


def gcnr(first: UInt8[np.ndarray, " n"], second: UInt8[np.ndarray, " m"]) -> float:
    """Compute the generalised contrast-to-noise ratio of two sets of grey values.

    It is 1 less the overlap of their histograms, with bins of 8 grey levels.

    Parameters
    ----------
    first, second : ndarray of uint8, shape (n,)
        Grey values; the sets may differ in size.

    Returns
    -------
    float
        Ratio from 0 (equal histograms) to 1 (no overlap).

    Raises
    ------
    InputError
        If a set is empty.

    References
    ----------
    A. Rodriguez-Molares et al., IEEE T-UFFC 67(4), 2020.
    """
    if not len(first) or not len(second):
        raise InputError("gcnr: expected two sets of pixels, received an empty one")
    bins = np.arange(0, 257, 8)
    shares = [np.histogram(values, bins)[0] / len(values) for values in (first, second)]
    return float(1.0 - np.minimum(*shares).sum())


def vessel_gcnr(image: UInt8[np.ndarray, "h w"], mask: Bool[np.ndarray, "h w"]) -> list[float]:
    """Compute the gCNR of each vessel against a ring around it, 0.6 of its radius wide.

    Vessels of fewer than 300 pixels are left out.

    Parameters
    ----------
    image : ndarray of uint8, shape (h, w)
        Grey values.
    mask : ndarray of bool, shape (h, w)
        Vessel pixels.

    Returns
    -------
    list of float
        One ratio for each vessel.
    """
    pieces, count = label(mask)
    found = []
    for piece in range(1, count + 1):
        own = pieces == piece
        if own.sum() < MIN_VESSEL_PX:
            continue
        width = max(4, int(0.6 * np.sqrt(own.sum() / np.pi)))
        ring = binary_dilation(own, iterations=width + 2) & ~binary_dilation(mask, iterations=2)
        inside = binary_erosion(own, iterations=2)
        if inside.any() and ring.any():
            found.append(gcnr(image[inside], image[ring]))
    return found


def grain_px(image: UInt8[np.ndarray, "h w"], seen: Bool[np.ndarray, "h w"]) -> Float64[np.ndarray, "2"]:
    """Measure the speckle size: the width of the grey levels' autocorrelation, median over all patches.

    Parameters
    ----------
    image : ndarray of uint8, shape (h, w)
        Grey values.
    seen : ndarray of bool, shape (h, w)
        Pixels that show tissue. Patches measure 48 px, lie wholly in it and are neither dark nor flat.

    Returns
    -------
    ndarray, shape (2,)
        Vertical and horizontal full width at half maximum in px; NaN without a patch.
    """
    widths = []
    for row in range(0, image.shape[0] - PATCH_PX, PATCH_PX):
        for column in range(0, image.shape[1] - PATCH_PX, PATCH_PX):
            window = slice(row, row + PATCH_PX), slice(column, column + PATCH_PX)
            patch = image[window].astype(np.float64)
            if not seen[window].all() or not 15 <= patch.mean() <= 200:
                continue
            patch -= gaussian_filter(patch, BACKGROUND_PX)
            patch -= patch.mean()
            if patch.std() >= 2:
                widths.append(_autocorrelation_widths(patch))
    if not widths:
        return np.array([np.nan, np.nan])
    return np.nanmedian(np.array(widths), axis=0)


def dark_dsc(image: UInt8[np.ndarray, "h w"], mask: Bool[np.ndarray, "h w"]) -> float:
    """Compute the DSC of all that is no brighter than Otsu's threshold against the vessel.

    It tells how far brightness alone gets.

    Parameters
    ----------
    image : ndarray of uint8, shape (h, w)
        Grey values.
    mask : ndarray of bool, shape (h, w)
        Vessel pixels.

    Returns
    -------
    float
        Dice similarity coefficient from 0 to 1; NaN where neither has a pixel.
    """
    from skimage.filters import threshold_otsu

    dark = image <= threshold_otsu(image)
    total = int(dark.sum() + mask.sum())
    return 2.0 * float((dark & mask).sum()) / total if total else float("nan")


def _autocorrelation_widths(patch: Float64[np.ndarray, "p p"]) -> tuple[float, float]:
    size = len(patch)
    spectrum = np.abs(np.fft.fft2(patch, (2 * size, 2 * size))) ** 2
    correlation = np.fft.ifft2(spectrum).real[: size // 2, : size // 2]
    overlap = size - np.arange(size // 2)
    correlation /= np.outer(overlap, overlap)
    correlation /= correlation[0, 0]
    return _width(correlation[:, 0]), _width(correlation[0])


def _width(course: Float64[np.ndarray, " n"]) -> float:
    below = np.flatnonzero(course < 0.5)
    if not len(below):
        return float("nan")
    first = int(below[0])
    return 2.0 * float(first - 1 + (course[first - 1] - 0.5) / (course[first - 1] - course[first]))
