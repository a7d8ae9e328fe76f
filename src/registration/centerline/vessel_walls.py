"""The walls of a vessel as a question answered often: how far is the nearest, and is a point inside."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float64

from registration.geometry.open3d_bridge import TriangleScene
from registration.geometry.shapes import Mesh
from registration.metrics.surface_distance import SurfaceDistance


class Walls:
    """Distances to ``wall`` and which side of ``closed`` a point lies on; both are the same but for the open ends.

    An open end is no wall: a sphere in it touches only the vessel. Its cap still decides where the inside stops.
    """

    def __init__(self, wall: Mesh, closed: Mesh) -> None:
        self._distance = SurfaceDistance(wall)
        self._closed = TriangleScene(closed)

    def inside(self, points_mm: Float64[np.ndarray, "n 3"]) -> Bool[np.ndarray, "n"]:
        """Whether each point is inside, by the majority of three rays' parities."""
        if not len(points_mm):
            return np.zeros(0, dtype=bool)
        return self._closed.occupied(points_mm)

    def distance_mm(self, points_mm: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n"]:
        """Distance of each point to the nearest wall: the radius of the largest sphere around it that fits."""
        return self._distance(points_mm)

    def ahead_mm(self, point_mm: Float64[np.ndarray, "3"], way: Float64[np.ndarray, "3"]) -> float:
        """How far it is from a point, along the unit vector ``way``, to the closed surface; infinite past it."""
        return float(self._closed.cast(point_mm[None], way[None])[0][0])
