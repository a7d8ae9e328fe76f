"""Vessel surfaces drawn by formula, for tests that need a shape whose every pose is different."""

from __future__ import annotations

import numpy as np

from registration.geometry.shapes import Mesh


def bent_tube(along: int = 80, around: int = 32) -> Mesh:
    """A closed tube of about 70 mm, bent in two planes, its radius growing from 3 to 6 mm, with a bulge on one side.

    No rotation, inversion or slide brings it onto itself. It lies away from the origin, obliquely to the axes.
    """
    share = np.linspace(0.0, 1.0, along)
    middle_mm = np.stack([12 * np.sin(1.5 * np.pi * share), 6 * np.cos(2.5 * share), 70 * share], axis=1)
    tangent = np.gradient(middle_mm, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side = np.cross(tangent, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(tangent, side)
    angle = 2 * np.pi * np.arange(around) / around
    bulge = 3 * np.exp(-(((share[:, None] - 0.7) / 0.08) ** 2)) * np.maximum(np.cos(angle - 1.0), 0)
    radius_mm = 3 + 3 * share[:, None] + bulge
    rim = np.cos(angle)[None, :, None] * side[:, None] + np.sin(angle)[None, :, None] * up[:, None]
    points_mm = (middle_mm[:, None] + radius_mm[..., None] * rim).reshape(-1, 3)
    points_mm = np.concatenate([points_mm, middle_mm[[0, -1]]])
    oblique = np.linalg.qr(np.array([[1.0, 0.4, 0.2], [-0.3, 1.0, 0.5], [0.1, -0.6, 1.0]]))[0]
    oblique *= np.sign(np.linalg.det(oblique))
    return Mesh(points_mm @ oblique.T + [150.0, -80.0, 40.0], _triangles(along, around))


def _triangles(along: int, around: int) -> np.ndarray:
    row, column = np.meshgrid(np.arange(along - 1), np.arange(around), indexing="ij")
    right = (column + 1) % around
    a, b = row * around + column, row * around + right
    c, d = (row + 1) * around + column, (row + 1) * around + right
    walls = np.concatenate([np.stack([a, b, d], axis=-1), np.stack([a, d, c], axis=-1)]).reshape(-1, 3)
    ring = np.arange(around)
    last = (along - 1) * around
    first_cap = np.stack([np.full(around, along * around), (ring + 1) % around, ring], axis=1)
    last_cap = np.stack(
        [np.full(around, along * around + 1), last + ring, last + (ring + 1) % around], axis=1
    )
    return np.concatenate([walls, first_cap, last_cap]).astype(np.int64)
