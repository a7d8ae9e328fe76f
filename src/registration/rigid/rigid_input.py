"""What a rigid method is given, checked and brought into one form before it works: clouds, lines, frames of points."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64, Int64
from numpy.typing import ArrayLike

from registration.errors import InputError
from registration.geometry.shapes import require_cloud, require_millimetres, require_points

# Larger numbers have no neighbours among the numbers that a computer stores.
MAX_FRAME = 2**53


def rigid_clouds(
    moving_mm: ArrayLike, fixed_mm: ArrayLike, min_points: int = 3
) -> tuple[Float64[np.ndarray, "m 3"], Float64[np.ndarray, "n 3"]]:
    """Bring both clouds into one form.

    Parameters
    ----------
    moving_mm : array_like, shape (m, 3)
        Moving points in mm.
    fixed_mm : array_like, shape (n, 3)
        Fixed points in mm.
    min_points : int, optional
        Smallest number of points.

    Returns
    -------
    moving_mm : ndarray, shape (m, 3)
        Moving points in mm as float64.
    fixed_mm : ndarray, shape (n, 3)
        Fixed points in mm as float64.

    Raises
    ------
    InputError
        If a cloud is of another shape, has too few points or coordinates that are not finite, lies on a line, or is so
        small that it must be in metres.
    """
    moving = require_millimetres(require_cloud(moving_mm, "moving_mm", min_points), "moving_mm")
    return moving, require_millimetres(require_cloud(fixed_mm, "fixed_mm", min_points), "fixed_mm")


def points_on_line(points_mm: ArrayLike | None, name: str) -> Float64[np.ndarray, "p 3"] | None:
    """Bring points on a centerline into one form.

    Parameters
    ----------
    points_mm : array_like, shape (p, 3), or None
        Points in mm, at least two.
    name : str
        Name of the argument, for messages.

    Returns
    -------
    ndarray, shape (p, 3), or None
        Points in mm as float64; None for None.

    Raises
    ------
    InputError
        If they are not at least two points.
    """
    return None if points_mm is None else require_points(points_mm, name, 2)


def frame_of_points(moving_frame: ArrayLike | None, count: int) -> Int64[np.ndarray, " m"] | None:
    """Bring the frames that points were seen in into one form.

    Parameters
    ----------
    moving_frame : array_like, shape (m,), or None
        Index of the frame of each point.
    count : int
        Number of points.

    Returns
    -------
    ndarray of int, shape (m,), or None
        Index of the frame of each point; None for None.

    Raises
    ------
    InputError
        Unless there is a whole number for each point.
    """
    if moving_frame is None:
        return None
    try:
        frame = np.asarray(moving_frame)
    except ValueError as refusal:
        raise InputError(
            f"moving_frame: expected one frame for each of {count} points, received {refusal}"
        ) from refusal
    if frame.ndim != 1 or len(frame) != count:
        received = len(frame) if frame.ndim == 1 else f"shape {frame.shape}"
        raise InputError(f"moving_frame: expected one frame for each of {count} points, received {received}")
    whole = frame.dtype.kind in "iu" or (
        frame.dtype.kind == "f" and bool(((np.abs(frame) < MAX_FRAME) & (np.round(frame) == frame)).all())
    )
    if not whole:
        raise InputError(f"moving_frame: expected whole numbers, received {frame.dtype}")
    return frame.astype(np.int64)
