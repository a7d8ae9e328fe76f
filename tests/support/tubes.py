"""Open tubes around lines of known shape, for tests that know the centerline."""

from __future__ import annotations

import numpy as np

from registration.geometry.shapes import Mesh


def tube(middle_mm: np.ndarray, radius_mm: np.ndarray | float, around: int = 32) -> Mesh:
    """The open tube around a line of points, wound outwards, its rings at right angles to the line."""
    count = len(middle_mm)
    along = np.gradient(middle_mm, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    side = np.cross(along[0], [0.31, 0.59, 0.74])
    first = np.empty_like(along)
    for place in range(count):
        # Carried along and straightened, so that the rings do not twist.
        side = side - (side @ along[place]) * along[place]
        side /= np.linalg.norm(side)
        first[place] = side
    second = np.cross(along, first)
    angle = 2 * np.pi * np.arange(around) / around
    ring = np.cos(angle)[None, :, None] * first[:, None] + np.sin(angle)[None, :, None] * second[:, None]
    radius = np.broadcast_to(np.asarray(radius_mm, dtype=float), count)
    vertices_mm = (middle_mm[:, None] + radius[:, None, None] * ring).reshape(-1, 3)
    row, column = np.meshgrid(np.arange(count - 1), np.arange(around), indexing="ij")
    right = (column + 1) % around
    a, b = row * around + column, row * around + right
    c, d = a + around, b + around
    walls = np.stack([np.stack([a, b, d], axis=-1), np.stack([a, d, c], axis=-1)])
    return Mesh(vertices_mm, walls.reshape(-1, 3).astype(np.int64))


def straight(length_mm: float = 40.0, step_mm: float = 0.8) -> np.ndarray:
    """A straight line away from the origin, oblique to all axes."""
    way = np.array([2.0, 3.0, 6.0]) / 7
    return np.array([30.0, -20, 50]) + np.arange(0, length_mm + step_mm / 2, step_mm)[:, None] * way


def helix(
    radius_mm: float = 15.0, pitch_mm: float = 30.0, turns: float = 1.25, points: int = 120
) -> np.ndarray:
    """A helix about the z axis."""
    angle = np.linspace(0, 2 * np.pi * turns, points)
    return np.stack(
        [radius_mm * np.cos(angle), radius_mm * np.sin(angle), pitch_mm * angle / (2 * np.pi)], axis=1
    )
