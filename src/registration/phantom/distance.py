"""Signed distance to a closed surface, precomputed on a grid so that hundreds of thousands of points are cheap."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Float64, Int64

from registration.geometry.open3d_bridge import TriangleScene
from registration.geometry.shapes import Mesh


@dataclass(frozen=True)
class DistanceGrid:
    """Signed distances at grid nodes: negative inside, capped at ``far_mm`` outside the grid.

    Parameters
    ----------
    values_mm : ndarray of float32, shape (a, b, c)
        Distance in mm at ``origin_mm + pitch_mm * (i, j, k)``.
    origin_mm : ndarray, shape (3,)
        Position of the first node in mm.
    pitch_mm : float
        Distance between nodes in mm.
    far_mm : float
        Largest distance in mm that is told apart.
    """

    values_mm: Float32[np.ndarray, "a b c"]
    origin_mm: Float64[np.ndarray, "3"]
    pitch_mm: float
    far_mm: float

    def at(self, points_mm: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, " n"]:
        """Interpolate the distance at points, trilinear between nodes.

        Parameters
        ----------
        points_mm : ndarray, shape (n, 3)
            Points in mm.

        Returns
        -------
        ndarray of float32, shape (n,)
            Distance in mm; ``far_mm`` outside the grid.
        """
        distance_mm = np.full(len(points_mm), self.far_mm, dtype=np.float32)
        inside, cell, share = self._locate(points_mm)
        corners = self._corners(cell)
        x, y, z = share.T
        # Corner order counts in binary, z fastest.
        low = corners[0] * (1 - x) + corners[4] * x, corners[1] * (1 - x) + corners[5] * x
        high = corners[2] * (1 - x) + corners[6] * x, corners[3] * (1 - x) + corners[7] * x
        distance_mm[inside] = (low[0] * (1 - z) + low[1] * z) * (1 - y) + (
            high[0] * (1 - z) + high[1] * z
        ) * y
        return distance_mm

    def normals(self, points_mm: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, "n 3"]:
        """Compute the direction in which the distance grows, by central differences over one pitch.

        Parameters
        ----------
        points_mm : ndarray, shape (n, 3)
            Points in mm.

        Returns
        -------
        ndarray of float32, shape (n, 3)
            Unit vectors; 0 where the distance is constant.
        """
        slopes = np.empty((len(points_mm), 3), dtype=np.float32)
        for axis in range(3):
            step_mm = np.zeros(3, dtype=np.float32)
            step_mm[axis] = 0.5 * self.pitch_mm
            slopes[:, axis] = self.at(points_mm + step_mm) - self.at(points_mm - step_mm)
        return slopes / np.maximum(np.linalg.norm(slopes, axis=1, keepdims=True), 1e-6)

    def _locate(
        self, points_mm: Float[np.ndarray, "n 3"]
    ) -> tuple[Int64[np.ndarray, " m"], Int64[np.ndarray, "m 3"], Float32[np.ndarray, "m 3"]]:
        last = np.array(self.values_mm.shape) - 1
        high_mm = self.origin_mm + self.pitch_mm * last
        within = np.ones(len(points_mm), dtype=bool)
        for axis in range(3):
            within &= points_mm[:, axis] >= self.origin_mm[axis]
            within &= points_mm[:, axis] < high_mm[axis]
        inside = np.flatnonzero(within)
        steps = (points_mm[inside] - self.origin_mm) / self.pitch_mm
        cell = np.minimum(steps.astype(np.int64), last - 1)
        return inside, cell, (steps - cell).astype(np.float32)

    def _corners(self, cell: Int64[np.ndarray, "m 3"]) -> list[Float32[np.ndarray, " m"]]:
        _, rows, columns = self.values_mm.shape
        flat = self.values_mm.reshape(-1)
        base = (cell[:, 0] * rows + cell[:, 1]) * columns + cell[:, 2]
        offsets = [i * rows * columns + j * columns + k for i in (0, 1) for j in (0, 1) for k in (0, 1)]
        return [flat[base + offset] for offset in offsets]


def distance_grid(mesh: Mesh, pitch_mm: float = 0.5, far_mm: float = 2.2) -> DistanceGrid:
    """Measure the signed distance to a closed mesh at the nodes of a box ``far_mm`` larger than it.

    Distances are exact to the triangles (Open3D's ray casting scene), the sign is by ray parity; both ways
    they are capped at ``far_mm``, so that only nodes near the surface need the costly exact value. A coarse
    grid finds those.

    Parameters
    ----------
    mesh : Mesh
        Closed surface in mm.
    pitch_mm : float, optional
        Distance between nodes in mm.
    far_mm : float, optional
        Largest distance in mm that is told apart.

    Returns
    -------
    DistanceGrid
        Distances at the nodes.
    """
    scene = TriangleScene(mesh, np.zeros(3))
    low_mm = mesh.vertices_mm.min(axis=0) - far_mm
    counts = np.ceil((mesh.vertices_mm.max(axis=0) + far_mm - low_mm) / (4 * pitch_mm)).astype(int) + 1
    coarse = _nodes(low_mm, counts, 4 * pitch_mm)
    coarse_mm = scene.distance_mm(coarse)
    # A node is at most half a coarse diagonal from a coarse node, and distance changes no faster than place.
    reach_mm = far_mm + 2 * pitch_mm * np.sqrt(3.0)
    near = np.repeat(np.repeat(np.repeat(coarse_mm <= reach_mm, 4, 0), 4, 1), 4, 2)
    fine = _nodes(low_mm - 2 * pitch_mm + 0.5 * pitch_mm, 4 * counts, pitch_mm)
    sign = np.where(scene.occupied(fine), -1.0, 1.0)
    values_mm = np.full(near.shape, far_mm, dtype=np.float32)
    values_mm[near] = np.minimum(scene.distance_mm(fine[near]), far_mm)
    return DistanceGrid(
        values_mm=(values_mm * sign).astype(np.float32),
        origin_mm=fine[0, 0, 0].astype(np.float64),
        pitch_mm=pitch_mm,
        far_mm=far_mm,
    )


def _nodes(
    low_mm: Float64[np.ndarray, "3"], counts: Int64[np.ndarray, "3"], pitch_mm: float
) -> Float32[np.ndarray, "a b c 3"]:
    axes_mm = [low_mm[axis] + pitch_mm * np.arange(counts[axis]) for axis in range(3)]
    return np.stack(np.meshgrid(*axes_mm, indexing="ij"), axis=-1).astype(np.float32)
