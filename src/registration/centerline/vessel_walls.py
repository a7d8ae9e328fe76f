"""Queries of a vessel's walls: distance to the nearest wall, and whether a point is inside."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float64

from registration.geometry.open3d_bridge import TriangleScene
from registration.geometry.shapes import Mesh
from registration.metrics.surface_distance import SurfaceDistance


class Walls:
    """Distances to the wall of a vessel, and which side of it a point lies on.

    An open end is no wall: a sphere in it touches only the vessel. Its cap still decides where the inside
    stops.

    Parameters
    ----------
    wall : Mesh
        Wall that distances are measured to, open at open ends.
    closed : Mesh
        The wall with its open ends capped, which bounds the inside.
    """

    def __init__(self, wall: Mesh, closed: Mesh) -> None:
        self._distance = SurfaceDistance(wall)
        self._closed = TriangleScene(closed)

    def inside(self, points_mm: Float64[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Decide whether points are inside, by the majority of three rays' parities.

        Parameters
        ----------
        points_mm : ndarray, shape (n, 3)
            Points in mm.

        Returns
        -------
        ndarray of bool, shape (n,)
            Whether each point is inside.
        """
        if not len(points_mm):
            return np.zeros(0, dtype=bool)
        return self._closed.occupied(points_mm)

    def distance_mm(self, points_mm: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, " n"]:
        """Compute the distance to the nearest wall, which is the radius of the largest sphere that fits.

        Parameters
        ----------
        points_mm : ndarray, shape (n, 3)
            Points in mm.

        Returns
        -------
        ndarray, shape (n,)
            Distances in mm.
        """
        return self._distance(points_mm)

    def ahead_mm(self, point_mm: Float64[np.ndarray, "3"], direction: Float64[np.ndarray, "3"]) -> float:
        """Compute the distance from a point along a direction to the closed surface.

        Parameters
        ----------
        point_mm : ndarray, shape (3,)
            Point in mm.
        direction : ndarray, shape (3,)
            Unit vector.

        Returns
        -------
        float
            Distance in mm; infinite where the surface is not met.
        """
        return float(self._closed.cast(point_mm[None], direction[None])[0][0])
