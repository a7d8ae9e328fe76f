"""The walls of a vessel as a question answered often: how far is the nearest, and is a point inside."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Bool, Float64

from registration.geometry.shapes import Mesh
from registration.metrics.surface_distance import SurfaceDistance


class Walls:
    """Distances to ``wall`` and which side of ``closed`` a point lies on; both are the same but for the open ends.

    An open end is no wall: a sphere in it touches only the vessel. Its cap still decides where the inside stops.
    """

    def __init__(self, wall: Mesh, closed: Mesh) -> None:
        self._distance = SurfaceDistance(wall)
        self._centre_mm = closed.vertices_mm.mean(axis=0)
        open3d = _open3d()
        self._scene = open3d.t.geometry.RaycastingScene()
        self._scene.add_triangles(
            open3d.core.Tensor((closed.vertices_mm - self._centre_mm).astype(np.float32)),
            open3d.core.Tensor(closed.triangles.astype(np.uint32)),
        )

    def inside(self, points_mm: Float64[np.ndarray, "n 3"]) -> Bool[np.ndarray, "n"]:
        """Whether each point is inside, by the majority of three rays' parities."""
        if not len(points_mm):
            return np.zeros(0, dtype=bool)
        queried = _open3d().core.Tensor((points_mm - self._centre_mm).astype(np.float32))
        found: np.ndarray = self._scene.compute_occupancy(queried, nsamples=3).numpy()
        return found > 0

    def distance_mm(self, points_mm: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n"]:
        """Distance of each point to the nearest wall: the radius of the largest sphere around it that fits."""
        return self._distance(points_mm)

    def ahead_mm(self, point_mm: Float64[np.ndarray, "3"], direction: Float64[np.ndarray, "3"]) -> float:
        """How far it is from a point, along the unit vector ``way``, to the closed surface; infinite past it."""
        ray = np.concatenate([point_mm - self._centre_mm, direction]).astype(np.float32)
        return float(self._scene.cast_rays(_open3d().core.Tensor(ray[None]))["t_hit"].numpy()[0])


def _open3d() -> Any:
    """Open3D, imported only where walls are asked: it takes a second, and its type stubs are not right."""
    import open3d

    return open3d
