"""What every reader does to the two streams of a sweep: poses in the order of time, frames of 8-bit grey."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64, UInt8

from registration.errors import InputError

# Weights of red, green and blue in luma, ITU-R BT.601.
_LUMA = np.array([0.299, 0.587, 0.114])


def distinct_times(
    times_s: Float64[np.ndarray, " n"], world_T_ee: Float64[np.ndarray, "n 4 4"], name: str
) -> tuple[Float64[np.ndarray, " m"], Float64[np.ndarray, "m 4 4"]]:
    """Leave out poses that repeat the one before (same time, same pose).

    Parameters
    ----------
    times_s : ndarray, shape (n,)
        Times in s.
    world_T_ee : ndarray, shape (n, 4, 4)
        Poses.
    name : str
        Name of the file, for messages.

    Returns
    -------
    times_s : ndarray, shape (m,)
        Times, strictly increasing.
    world_T_ee : ndarray, shape (m, 4, 4)
        Poses at these times.

    Raises
    ------
    InputError
        If times run backwards, or one time has two poses that differ.
    """
    if not len(times_s):
        return times_s, world_T_ee
    repeated = (np.diff(times_s) == 0) & (np.abs(np.diff(world_T_ee, axis=0)).max(axis=(1, 2)) == 0)
    keep = np.concatenate([[True], ~repeated])
    times_s, world_T_ee = times_s[keep], world_T_ee[keep]
    backwards = np.flatnonzero(np.diff(times_s) <= 0)
    if len(backwards):
        at = int(backwards[0])
        raise InputError(
            f"{name}: expected poses in the order of their times, "
            f"found {times_s[at + 1]:.6f} s after {times_s[at]:.6f} s (pose {at + 1})"
        )
    return times_s, world_T_ee


def as_grey(pixels: np.ndarray, name: str) -> UInt8[np.ndarray, "n height width"]:
    """Convert frames to 8-bit grey; colour is weighed to luma.

    Parameters
    ----------
    pixels : ndarray, shape (n, height, width) or (n, height, width, channels)
        Frames; types other than 8 bits are taken where their values lie in 0 to 255.
    name : str
        Name of the file, for messages.

    Returns
    -------
    ndarray, shape (n, height, width)
        Frames in grey of 8 bits.

    Raises
    ------
    InputError
        If values lie outside or are no whole numbers.
    """
    fits = pixels.dtype.kind in "iu" and (pixels.size == 0 or (pixels.min() >= 0 and pixels.max() <= 255))
    if not fits:
        raise InputError(f"{name}: expected pixels of whole numbers from 0 to 255, found {pixels.dtype}")
    pixels = pixels.astype(np.uint8, copy=False)
    if pixels.ndim == 4 and pixels.shape[3] >= 3:
        return np.rint(pixels[..., :3] @ _LUMA).astype(np.uint8)
    return pixels[..., 0] if pixels.ndim == 4 else pixels
