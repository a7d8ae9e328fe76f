"""Bodies with an outer and an inner wall around lines of known shape, and vessels that close to a loop."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from tubes import tube

from registration.geometry.mesh_topology import borders, with_caps
from registration.geometry.shapes import Mesh

Field = Callable[[np.ndarray], np.ndarray]


def hollow(
    line_mm: np.ndarray, outer_mm: float, inner_mm: float, ends: Sequence[str] = ("joined", "joined")
) -> Mesh:
    """The wall between two tubes; each end is ``joined`` by a rim, left ``open``, or ``closed`` by two caps."""
    around = 32
    outer, inner = tube(line_mm, outer_mm, around), tube(line_mm, inner_mm, around)
    count, ring = len(outer.vertices_mm), np.arange(around)
    both = together(outer, Mesh(inner.vertices_mm, inner.triangles[:, ::-1]))
    vertices_mm, triangles = both.vertices_mm, [both.triangles]
    following = np.roll(ring, -1)
    for end, first in zip(ends, (0, count - around), strict=True):
        a, b = first + ring, first + following
        if end == "joined":
            rim = np.concatenate([np.stack([a, b, b + count], 1), np.stack([a, b + count, a + count], 1)])
            triangles.append(rim[:, ::-1] if first == 0 else rim)
        elif end == "closed":
            for wall, turned in ((0, first == 0), (count, first != 0)):
                middle = np.full(around, len(vertices_mm))
                vertices_mm = np.concatenate([vertices_mm, line_mm[[0 if first == 0 else -1]]])
                fan = np.stack([a + wall, b + wall, middle], 1)
                triangles.append(fan[:, ::-1] if turned else fan)
    return Mesh(vertices_mm, np.concatenate(triangles))


def capped(mesh: Mesh) -> Mesh:
    """The mesh with flat caps on its ends."""
    return with_caps(mesh, borders(mesh), 3)


def together(*meshes: Mesh) -> Mesh:
    """Several meshes as one."""
    offset = np.cumsum([0] + [len(mesh.vertices_mm) for mesh in meshes])
    return Mesh(
        np.concatenate([mesh.vertices_mm for mesh in meshes]),
        np.concatenate([mesh.triangles + first for mesh, first in zip(meshes, offset, strict=False)]),
    )


def ring(middle_mm: float, radius_mm: float) -> Mesh:
    """A tube that closes to a ring around z, with that radius of its middle."""
    around, across = 72, 24
    u, v = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    turn, tilt = 2 * np.pi * u / around, 2 * np.pi * v / across
    away_mm = middle_mm + radius_mm * np.cos(tilt)
    places_mm = np.stack([away_mm * np.cos(turn), away_mm * np.sin(turn), radius_mm * np.sin(tilt)], axis=-1)

    def corner(i: np.ndarray, j: np.ndarray) -> np.ndarray:
        return (i % around) * across + j % across

    one = np.stack([corner(u, v), corner(u + 1, v), corner(u + 1, v + 1)], axis=-1)
    other = np.stack([corner(u, v), corner(u + 1, v + 1), corner(u, v + 1)], axis=-1)
    return Mesh(places_mm.reshape(-1, 3), np.concatenate([one.reshape(-1, 3), other.reshape(-1, 3)]))


def rod(begin_mm: Sequence[float], end_mm: Sequence[float]) -> Field:
    """Distance to a straight line between two points."""
    begin, way = np.array(begin_mm, float), np.subtract(end_mm, begin_mm).astype(float)

    def distance_mm(points_mm: np.ndarray) -> np.ndarray:
        share = np.clip((points_mm - begin) @ way / (way @ way), 0, 1)
        return np.asarray(np.linalg.norm(points_mm - begin - share[:, None] * way, axis=1))

    return distance_mm


def nearest(*fields: Field) -> Field:
    """Distance to the nearest of several shapes."""
    return lambda points_mm: np.minimum.reduce([field(points_mm) for field in fields])


def zero_surface(field: Field, low_mm: Sequence[float], high_mm: Sequence[float], pitch_mm: float) -> Mesh:
    """Where a field is zero, wound towards its positive side."""
    from skimage.measure import marching_cubes

    axes = [np.arange(low, high, pitch_mm) for low, high in zip(low_mm, high_mm, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    values = field(grid.reshape(-1, 3)).reshape(grid.shape[:-1])
    corners, triangles, _, _ = marching_cubes(values, 0.0, gradient_direction="descent")
    return Mesh(corners.astype(np.float64) * pitch_mm + np.array(low_mm, float), triangles.astype(np.int64))
