"""Extension of a centerline to the end of a vessel that is closed there."""

from __future__ import annotations

import numpy as np

from registration.centerline.vessel_walls import Walls
from registration.geometry.shapes import Polyline

# Largest distance of the end, in radii: a blunt end is less than two radii past the last sphere that fills the vessel.
MAX_RADII = 3.0


def extend_to_closed_end(line: Polyline, walls: Walls, step_mm: float) -> Polyline:
    """Extend a line straight from its last point to the wall ahead, with the radius that it had there.

    Parameters
    ----------
    line : Polyline
        Line that ends at the last sphere that fills the vessel.
    walls : Walls
        Walls of the vessel.
    step_mm : float
        Approximate distance of the added points in mm.

    Returns
    -------
    Polyline
        The extended line, or ``line`` itself where there is no wall within three radii ahead.

    Notes
    -----
    The direction is that of the line's last radius. A cap is no more a wall of the vessel than an opening is:
    the radius stays that of the last sphere that fills the vessel, and a tube has the same line whether it is
    open or capped. The length is then that of the vessel, from end to end.
    """
    radius_mm = float(line.radius_mm[-1])
    back_mm = np.linalg.norm(line.points_mm - line.points_mm[-1], axis=1)
    behind = np.flatnonzero(back_mm >= radius_mm)
    way = line.points_mm[-1] - line.points_mm[behind[-1] if len(behind) else 0]
    length_mm = float(np.linalg.norm(way))
    if not length_mm > 0:
        return line
    ahead_mm = walls.ahead_mm(line.points_mm[-1], way / length_mm)
    if not 0 < ahead_mm <= MAX_RADII * radius_mm:
        return line
    count = max(round(ahead_mm / step_mm), 1)
    on_mm = np.linspace(0.0, ahead_mm, count + 1)[1:, None] * way / length_mm
    return Polyline(
        np.concatenate([line.points_mm, line.points_mm[-1] + on_mm]),
        np.concatenate([line.radius_mm, np.full(count, radius_mm)]),
    )


def reversed_line(line: Polyline) -> Polyline:
    """Reverse the order of a line's points.

    Parameters
    ----------
    line : Polyline
        Any line.

    Returns
    -------
    Polyline
        The line from its last point to its first.
    """
    return Polyline(line.points_mm[::-1], line.radius_mm[::-1])
