"""What a surface sees outside of itself, by rays: how much of the sky, and the wall opposite."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64, Int64

from registration.geometry.open3d_bridge import TriangleScene
from registration.geometry.shapes import Mesh

# Directions in which every triangle looks out.
DIRECTIONS = 64


class OutwardRays:
    """Visibility from the triangles of a body to its outside, by rays.

    Parameters
    ----------
    body : Mesh
        Body in mm, wound outwards.
    """

    def __init__(self, body: Mesh) -> None:
        a, b, c = np.moveaxis(body.corners_mm, 1, 0)
        facing = np.cross(b - a, c - a)
        self._normals = facing / np.maximum(np.linalg.norm(facing, axis=1, keepdims=True), 1e-300)
        self._scene = TriangleScene(body)
        step_mm = 1e-4 * float(np.linalg.norm(np.ptp(body.vertices_mm, axis=0)))
        self._from_mm = body.corners_mm.mean(axis=1) + step_mm * self._normals

    def across(
        self, triangles: Int64[np.ndarray, " n"]
    ) -> tuple[Float64[np.ndarray, " n"], Int64[np.ndarray, " n"]]:
        """Measure from each triangle along its normal how far away the body is.

        Parameters
        ----------
        triangles : ndarray, shape (n,)
            Indices of triangles.

        Returns
        -------
        distance_mm : ndarray, shape (n,)
            Distance in mm, infinite where the normal meets nothing.
        met : ndarray, shape (n,)
            Index of the triangle met.
        """
        return self._scene.cast(self._from_mm[triangles], self._normals[triangles])

    def sky(self, triangles: Int64[np.ndarray, " n"]) -> Float64[np.ndarray, " n"]:
        """Compute the share of all directions in front of each triangle in which the body is not in the way.

        The directions are the same for all triangles, so that neighbours get like values.

        Parameters
        ----------
        triangles : ndarray, shape (n,)
            Indices of triangles.

        Returns
        -------
        ndarray, shape (n,)
            Shares, 0 to 1.
        """
        seen, ahead = np.zeros(len(triangles)), np.zeros(len(triangles))
        for way in _directions(DIRECTIONS):
            front = np.flatnonzero(self._normals[triangles] @ way > 0.05)
            if not len(front):
                continue
            reach_mm, _ = self._scene.cast(
                self._from_mm[triangles[front]], np.broadcast_to(way, (len(front), 3))
            )
            seen[front] += np.isinf(reach_mm)
            ahead[front] += 1
        return seen / np.maximum(ahead, 1)


def _directions(count: int) -> Float64[np.ndarray, "{count} 3"]:
    """Directions spread evenly over the sphere, on a spiral (Vogel, Math. Biosci. 44, 1979)."""
    place = np.arange(count) + 0.5
    height = 1 - 2 * place / count
    angle = np.pi * (1 + np.sqrt(5)) * place
    across = np.sqrt(1 - height**2)
    return np.stack([across * np.cos(angle), across * np.sin(angle), height], axis=1)
