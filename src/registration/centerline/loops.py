"""Loops in vessels: a tree of lines from one source omits one way around a loop."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from registration.centerline.medial_axis import MedialAxis
from registration.errors import InputError
from registration.geometry.shapes import Polyline

# Smallest width of a loop, in radii, between the places where it leaves the lines. A handle made by noise, or a hole
# in the wall of a flat vessel, is narrower.
LOOP_RADII = 2.0


def require_no_loop(axis: MedialAxis, lines: Sequence[Polyline], handles: int) -> None:
    """Require that no part of the vessel connects two places of the lines without a line of its own.

    Each sphere off the lines belongs to the place of the lines from which it is reached first; where spheres
    of two distant places are neighbours, a loop closes.

    Parameters
    ----------
    axis : MedialAxis
        Inscribed spheres of the vessel.
    lines : sequence of Polyline
        Lines that were found.
    handles : int
        Genus of the surface, for the message.

    Raises
    ------
    InputError
        If the vessel closes to a loop.
    """
    points_mm = np.concatenate([line.points_mm for line in lines])
    radius_mm = np.concatenate([line.radius_mm for line in lines])
    apart_mm, nearest = cKDTree(points_mm).query(axis.centres_mm)
    covered = np.flatnonzero(apart_mm <= radius_mm[nearest])
    if not len(covered):
        return
    away_mm, _, place = dijkstra(
        axis.shortcuts_mm, directed=False, indices=covered, min_only=True, return_predecessors=True
    )
    links = axis.apart_mm.tocoo()
    off_lines = (away_mm[links.row] > 0) & (away_mm[links.col] > 0)
    first, second = links.row[off_lines], links.col[off_lines]
    if not len(first):
        return
    one, other = place[first], place[second]
    wide_mm = np.linalg.norm(axis.centres_mm[one] - axis.centres_mm[other], axis=1)
    radii = wide_mm / np.maximum(radius_mm[nearest[one]], radius_mm[nearest[other]])
    closing = int(radii.argmax())
    if radii[closing] > LOOP_RADII:
        where_mm = ", ".join(f"{value:.1f}" for value in axis.centres_mm[first[closing]])
        raise InputError(
            f"surface: expected a vessel that branches like a tree, received one that closes to a loop at "
            f"({where_mm}) mm (genus {handles}, both ways {wide_mm[closing]:.1f} mm apart): cut the loop open or "
            "give its ends"
        )
