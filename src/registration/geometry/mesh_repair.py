"""A mesh as programs write them, made ready for what follows: one vertex a place, one piece, wound outwards."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from registration.brief import brief_repr
from registration.errors import InputError
from registration.geometry.hollow import Lumen, find_lumen
from registration.geometry.mesh_quality import enclosed_volume_mm3
from registration.geometry.mesh_topology import directed_edges, largest_piece, pieces, row_numbers
from registration.geometry.open3d_bridge import triangle_body
from registration.geometry.shapes import Mesh


@dataclass(frozen=True)
class Repaired:
    """A mesh and what was done to it.

    Parameters
    ----------
    mesh : Mesh
        Repaired mesh; of a hollow body the lumen's wall.
    vertices_merged : int
        Number of vertices that had another at the same place.
    triangles_dropped : int
        Number of triangles without area or there twice.
    triangles_turned : int
        Number of triangles that were wound the other way.
    pieces_dropped : int
        Number of pieces smaller than the one that was kept.
    area_dropped_mm2 : float
        Area of these pieces.
    lumen : Lumen, optional
        How the lumen of a hollow body was found; None for other surfaces.
    """

    mesh: Mesh
    vertices_merged: int
    triangles_dropped: int
    triangles_turned: int
    pieces_dropped: int
    area_dropped_mm2: float
    lumen: Lumen | None = None

    __repr__ = brief_repr


def repair(mesh: Mesh) -> Repaired:
    """Merge equal vertices, drop empty and double triangles, wind all outwards, and keep the largest piece.

    Of a body with an outer and an inner wall, joined or not, the inner one is kept, the lumen's (see
    ``registration.geometry.hollow``). Holes, crossings and edges with more than two triangles stay:
    ``mesh_quality`` reports them.

    Parameters
    ----------
    mesh : Mesh
        Mesh as programs write them, in mm.

    Returns
    -------
    Repaired
        Repaired mesh and what was done.

    Raises
    ------
    InputError
        If no triangle with area is left, or the lumen of a hollow body is ambiguous.
    """
    vertices_mm, owner = np.unique(mesh.vertices_mm, axis=0, return_inverse=True)
    triangles = owner.reshape(-1)[mesh.triangles]
    corners = np.sort(triangles, axis=1)
    flat = (np.diff(corners, axis=1) == 0).any(axis=1) | (Mesh(vertices_mm, triangles).areas_mm2 <= 0)
    _, first = np.unique(row_numbers(corners), return_index=True)
    kept = np.zeros(len(triangles), dtype=bool)
    kept[first] = True
    kept &= ~flat
    if not kept.any():
        raise InputError("mesh: expected triangles with area, received none")
    whole = Mesh(vertices_mm, triangles[kept])
    lumen = find_lumen(_wound_alike(whole))
    one = largest_piece(whole) if lumen is None else lumen.mesh
    wound = _outward(_wound_alike(one))
    turns = [(np.roll(one.triangles, turn, axis=1) == wound.triangles).all(axis=1) for turn in range(3)]
    return Repaired(
        mesh=wound,
        vertices_merged=len(mesh.vertices_mm) - len(vertices_mm),
        triangles_dropped=int((~kept).sum()),
        triangles_turned=int((~np.any(turns, axis=0)).sum()),
        pieces_dropped=pieces(whole)[0] - 1,
        area_dropped_mm2=float(whole.areas_mm2.sum() - one.areas_mm2.sum()),
        lumen=lumen,
    )


def _wound_alike(mesh: Mesh) -> Mesh:
    """Turn triangles until neighbours are wound alike, where the surface has two sides."""
    edges = directed_edges(mesh) @ np.array([len(mesh.vertices_mm), 1])
    if len(np.unique(edges)) == len(edges):
        return mesh
    body = triangle_body(mesh)
    if not body.orient_triangles():
        return mesh
    return Mesh(mesh.vertices_mm, np.asarray(body.triangles, dtype=np.int64))


def _outward(mesh: Mesh) -> Mesh:
    if enclosed_volume_mm3(mesh) >= 0:
        return mesh
    return Mesh(mesh.vertices_mm, np.ascontiguousarray(mesh.triangles[:, ::-1]))
