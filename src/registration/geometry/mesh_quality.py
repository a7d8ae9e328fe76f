"""Whether a surface is what later steps take it for: closed, manifold, wound one way, in one piece."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from registration.geometry.mesh_topology import borders, connected, directed_edges, edge_numbers, pieces
from registration.geometry.shapes import Mesh


@dataclass(frozen=True)
class MeshQuality:
    """What was found about a triangle mesh.

    Parameters
    ----------
    vertices : int
        Number of vertices.
    triangles : int
        Number of triangles.
    pieces : int
        Number of connected pieces.
    watertight : bool
        Whether there is no border.
    manifold : bool
        Whether no edge has more than two triangles and at no vertex two fans meet.
    oriented : bool
        Whether neighbouring triangles are wound alike, and outwards where the mesh is closed.
    open_ends : int
        Number of borders that a vessel runs out of.
    holes : int
        Number of the other borders.
    degenerate : int
        Number of triangles without area.
    area_mm2 : float
        Area of all triangles.
    volume_mm3 : float
        Volume enclosed, open ends closed by flat caps; negative when wound inwards.
    """

    vertices: int
    triangles: int
    pieces: int
    watertight: bool
    manifold: bool
    oriented: bool
    open_ends: int
    holes: int
    degenerate: int
    area_mm2: float
    volume_mm3: float


def mesh_quality(mesh: Mesh) -> MeshQuality:
    """Check every edge, vertex and border of a mesh; an empty one has no piece and is not watertight.

    Parameters
    ----------
    mesh : Mesh
        Mesh in mm.

    Returns
    -------
    MeshQuality
        Counts and properties.

    Examples
    --------
    >>> corners_mm = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    >>> mesh_quality(Mesh(corners_mm, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))).watertight
    True
    """
    edges = directed_edges(mesh)
    numbers = edge_numbers(edges, len(mesh.vertices_mm))
    _, uses = np.unique(numbers, return_counts=True)
    directed = np.unique(edges @ np.array([len(mesh.vertices_mm), 1]), return_counts=True)[1]
    rims = borders(mesh)
    volume_mm3 = enclosed_volume_mm3(mesh)
    watertight = bool(len(edges)) and not len(rims) and bool((uses == 2).all())
    alike = bool((directed == 1).all())
    ends = sum(rim.is_end for rim in rims)
    return MeshQuality(
        vertices=len(mesh.vertices_mm),
        triangles=len(mesh.triangles),
        pieces=pieces(mesh)[0],
        watertight=watertight,
        manifold=bool((uses <= 2).all()) and _one_fan_each(mesh),
        oriented=alike and (volume_mm3 > 0 or not watertight),
        open_ends=ends,
        holes=len(rims) - ends,
        degenerate=int((mesh.areas_mm2 <= 0).sum()),
        area_mm2=float(mesh.areas_mm2.sum()),
        volume_mm3=volume_mm3,
    )


def enclosed_volume_mm3(mesh: Mesh) -> float:
    """Compute the volume inside by the divergence theorem, borders closed by fans.

    Parameters
    ----------
    mesh : Mesh
        Mesh in mm.

    Returns
    -------
    float
        Volume in mm^3, negative when wound inwards.
    """
    if not len(mesh.triangles):
        return 0.0
    middle_mm = mesh.vertices_mm[np.unique(mesh.triangles)].mean(axis=0)
    volume_mm3 = _cones_mm3(mesh.corners_mm - middle_mm)
    for rim in borders(mesh):
        start_mm, end_mm = mesh.vertices_mm[rim.edges[:, 0]], mesh.vertices_mm[rim.edges[:, 1]]
        centre_mm = np.broadcast_to(rim.centre_mm, start_mm.shape)
        volume_mm3 += _cones_mm3(np.stack([end_mm, start_mm, centre_mm], axis=1) - middle_mm)
    return volume_mm3


def _cones_mm3(corners_mm: np.ndarray) -> float:
    a, b, c = np.moveaxis(corners_mm, 1, 0)
    return float(np.einsum("ti,ti->t", a, np.cross(b, c)).sum()) / 6


def _one_fan_each(mesh: Mesh) -> bool:
    """Whether the triangles around every vertex hang together by edges at that vertex.

    Corners of triangles are linked where two triangles share an edge at that corner's vertex; as many sets of linked
    corners as vertices means one fan each.
    """
    corners = mesh.triangles.reshape(-1)
    size = len(mesh.vertices_mm)
    # Each corner names the two edges at it: from its vertex to the triangle's next and previous one.
    others = np.concatenate([np.roll(mesh.triangles, -1, axis=1), np.roll(mesh.triangles, 1, axis=1)])
    keys = np.concatenate([corners, corners]) * size + others.reshape(-1)
    owners = np.tile(np.arange(len(corners)), 2)
    order = np.argsort(keys, kind="stable")
    same = np.flatnonzero(keys[order][1:] == keys[order][:-1])
    links = np.stack([owners[order][same], owners[order][same + 1]], axis=1)
    return bool(connected(links, len(corners))[0] == len(np.unique(corners)))
