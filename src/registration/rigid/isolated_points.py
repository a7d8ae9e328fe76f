"""Isolated points: they say nothing of a vessel's axis and length, but are what both are measured to."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float64

from registration.rigid.icp.correspondence import search_tree

# A point is isolated if this neighbour of its own is so many times as far away as that of most points.
NEIGHBOUR, ISOLATION_FACTOR = 8, 4.0
# In smaller clouds the neighbours are too few to tell.
MIN_CLOUD_POINTS = 50


def isolated_points(points_mm: Float64[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
    """Find the points that have hardly any others around them.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3)
        Points in mm.

    Returns
    -------
    ndarray of bool, shape (n,)
        True where a point is isolated; nowhere in a cloud of less than 50 points.
    """
    if len(points_mm) < MIN_CLOUD_POINTS:
        return np.zeros(len(points_mm), dtype=bool)
    squared_mm2 = search_tree(points_mm).batch_knn_search(points_mm, NEIGHBOUR + 1)[1]
    return is_isolated(np.sqrt(np.asarray(squared_mm2)[:, -1]))


def is_isolated(away_mm: Float64[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Find the isolated points from the distances to their neighbours.

    Parameters
    ----------
    away_mm : ndarray, shape (n,)
        Distance in mm from each point to its eighth neighbour.

    Returns
    -------
    ndarray of bool, shape (n,)
        True where a point is isolated.
    """
    return away_mm > ISOLATION_FACTOR * np.median(away_mm)
