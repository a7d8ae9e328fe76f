"""What a rigid method is given, checked and brought into one form before it works: clouds, lines, frames of points."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64, Int64
from numpy.typing import ArrayLike

from registration.errors import InputError
from registration.geometry.shapes import require_cloud, require_millimetres, require_points


def rigid_clouds(
    moving_mm: ArrayLike, fixed_mm: ArrayLike, min_points: int = 3
) -> tuple[Float64[np.ndarray, "m 3"], Float64[np.ndarray, "n 3"]]:
    """Both clouds as float64 of shape (n, 3), from arrays or lists.

    Raises InputError, by name, for a cloud of another shape, of fewer than ``least`` points, with coordinates that are
    not finite, on a line, or so small that it must be in metres.
    """
    moving = require_millimetres(require_cloud(moving_mm, "moving_mm", min_points), "moving_mm")
    return moving, require_millimetres(require_cloud(fixed_mm, "fixed_mm", min_points), "fixed_mm")


def points_on_line(points_mm: ArrayLike | None, name: str) -> Float64[np.ndarray, "p 3"] | None:
    """At least two points on a centerline as float64, or None as it is."""
    return None if points_mm is None else require_points(points_mm, name, 2)


def frame_of_points(moving_frame: ArrayLike | None, count: int) -> Int64[np.ndarray, "m"] | None:
    """The frame that each of ``count`` points was seen in, or None as it is.

    Raises InputError unless there is a whole number for each point.
    """
    if moving_frame is None:
        return None
    frame = np.asarray(moving_frame)
    if frame.ndim != 1 or len(frame) != count:
        received = len(frame) if frame.ndim == 1 else f"shape {frame.shape}"
        raise InputError(f"moving_frame: expected one frame for each of {count} points, received {received}")
    if frame.dtype.kind not in "iuf" or not np.equal(np.mod(frame, 1), 0).all():
        raise InputError(f"moving_frame: expected whole numbers, received {frame.dtype}")
    return frame.astype(np.int64)
