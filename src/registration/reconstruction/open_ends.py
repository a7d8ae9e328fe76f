"""Open ends of a closed reconstruction, cut where the measured points end.

A Poisson surface is closed: it bulges out of every open end. Cutting by the density of points removes wall
and bulge alike. Here the surface is cut along the line where the measured points end.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64, Int64
from scipy.sparse import coo_array, csr_array
from scipy.spatial import cKDTree

from registration.checks import require_positive
from registration.geometry.mesh_topology import (
    TrianglesAt,
    borders,
    connected,
    directed_edges,
    edge_numbers,
)
from registration.geometry.point_cloud import OrientedCloud
from registration.geometry.shapes import Mesh
from registration.reconstruction.outlier_filters import VoxelDownsampling

# Points count for a vertex whose normal is within 60 degrees of theirs: the bulge's middle has none.
MIN_COSINE = 0.5
# Cells along ``bridge_mm`` that the cloud is downsampled to, which bounds the number of neighbours of a vertex.
CELLS_A_BRIDGE = 12
# Depth of what is kept although nothing was measured there: just inside.
SHALLOW_MM = 1e-6
# A border is judged by the triangles within two rings of it; beyond so many nothing changes it.
RINGS = 5
# Vertices processed at a time, which bounds the memory.
BLOCK = 2000


def measured_part(mesh: Mesh, cloud: OrientedCloud, bridge_mm: float) -> Mesh:
    """Cut a reconstruction where the points that it was made from end (see ``beyond_mm``).

    A part beyond the points that closes a hole no wider than ``bridge_mm`` in the middle of a wall is kept:
    contours pass around the crotch of a bifurcation, and the surface there is right all the same.

    Parameters
    ----------
    mesh : Mesh
        Reconstructed surface.
    cloud : OrientedCloud
        Points with normals that the surface was made from, in the same coordinate frame.
    bridge_mm : float
        Width in mm of the widest gap between points that stays closed.

    Returns
    -------
    Mesh
        The surface, open where the points end.

    Raises
    ------
    InputError
        If ``bridge_mm`` is not positive.
    """
    past_mm = beyond_mm(mesh, cloud, bridge_mm)
    out = past_mm > 0
    edges = directed_edges(mesh)
    piece = connected(edges[out[edges].all(axis=1)], len(past_mm))[1]
    around = _Surroundings(mesh)
    members = np.flatnonzero(out)
    members = members[np.argsort(piece[members], kind="stable")]
    for own in np.split(members, np.flatnonzero(np.diff(piece[members])) + 1):
        if len(own) and around.is_hole(own, past_mm, bridge_mm):
            past_mm[own] = -SHALLOW_MM
    return clip(mesh, past_mm)


class _Surroundings:
    """Neighbourhoods of a mesh, so that a hole is judged in its own: rough masks leave hundreds of them.

    Parameters
    ----------
    mesh : Mesh
        Surface.
    """

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        count = len(mesh.vertices_mm)
        edges = directed_edges(mesh)
        ones = np.ones(len(edges), dtype=bool)
        neighbours = coo_array((ones, edges.T), shape=(count, count)).tocsr()
        self.neighbours = csr_array(neighbours + neighbours.T)
        self.triangles_at = TrianglesAt(mesh)

    def is_hole(
        self, own: Int64[np.ndarray, " o"], past_mm: Float64[np.ndarray, " v"], bridge_mm: float
    ) -> bool:
        """Tell whether vertices close a narrow hole in the middle of a wall.

        Parameters
        ----------
        own : ndarray of int, shape (o,)
            Indices of the vertices.
        past_mm : ndarray, shape (v,)
            How far each vertex of the mesh lies past the points, in mm.
        bridge_mm : float
            Largest radius in mm of such a hole.

        Returns
        -------
        bool
            False if they are an open end, or reach the border of the mesh.
        """
        ring, rings = own, [own]
        for _ in range(RINGS):
            ring = np.setdiff1d(self.neighbours[ring].indices, np.concatenate(rings))
            rings.append(ring)
        inner = np.concatenate(rings[:-1])
        used, corners = np.unique(self.mesh.triangles[self.triangles_at(inner)], return_inverse=True)
        part = Mesh(self.mesh.vertices_mm[used], corners.reshape(-1, 3).astype(np.int64))
        values = np.where(np.isin(used, own), past_mm[used], np.minimum(past_mm[used], -SHALLOW_MM))
        cut, ends = _cut(part, values, 0.0)
        # Where the part itself ends is no border of the surface.
        outermost, touching = (np.isin(used, some)[ends].any(axis=1) for some in (ring, own))
        for rim in borders(cut):
            if not outermost[rim.edges].any():
                if rim.is_end or rim.radius_mm > bridge_mm:
                    return False
            elif touching[rim.edges].any():  # it goes on along the border of the mesh
                return False
        return True


def beyond_mm(mesh: Mesh, cloud: OrientedCloud, bridge_mm: float) -> Float64[np.ndarray, " v"]:
    """Compute how far each vertex lies past the last measured points, along the surface.

    Parameters
    ----------
    mesh : Mesh
        Reconstructed surface.
    cloud : OrientedCloud
        Points with normals that the surface was made from, in the same coordinate frame.
    bridge_mm : float
        Radius in mm within which points around a vertex count.

    Returns
    -------
    ndarray, shape (v,)
        Distances in mm; negative inside the measured part, 0 at its last ring of points, ``bridge_mm`` where
        no points are near.

    Raises
    ------
    InputError
        If ``bridge_mm`` is not positive.

    Notes
    -----
    Around each vertex, the points of the cloud within ``bridge_mm`` that face the same way are projected to
    their mean plane. The direction from their mean to the vertex points outwards; how far the farthest of
    them lies past the vertex in that direction is how far the vertex is inside. So gaps of up to
    ``bridge_mm``, measured on both sides, are inside.
    """
    require_positive("bridge_mm", bridge_mm)
    cloud = VoxelDownsampling(bridge_mm / CELLS_A_BRIDGE)(cloud).cloud
    normals = vertex_normals(mesh)
    tree = cKDTree(cloud.points_mm)
    found_mm = np.full(len(normals), float(bridge_mm))
    for block in np.array_split(np.arange(len(normals)), 1 + len(normals) // BLOCK):
        near = tree.query_ball_point(mesh.vertices_mm[block], bridge_mm, return_sorted=False)
        sizes = np.array([len(found) for found in near])
        if not sizes.sum():
            continue
        owner = np.repeat(np.arange(len(block)), sizes)
        points = np.concatenate([np.array(found, dtype=np.int64) for found in near])
        facing = np.einsum("pi,pi->p", cloud.normals[points], normals[block][owner]) >= MIN_COSINE
        owner, points = owner[facing], points[facing]
        offset_mm = cloud.points_mm[points] - mesh.vertices_mm[block][owner]
        found_mm[block] = _past_mm(offset_mm, cloud.normals[points], owner, len(block), bridge_mm)
    return found_mm


def _past_mm(
    offset_mm: np.ndarray, facing: np.ndarray, owner: np.ndarray, count: int, bridge_mm: float
) -> np.ndarray:
    """For each of ``count`` vertices, how far it lies past the points whose offsets from it are given."""
    weights = np.maximum(1 - (offset_mm**2).sum(axis=1) / bridge_mm**2, 0.0) + 1e-9
    # The plane is the wall's and not the surface's: a bulge turns inwards and would face the far side of the rim.
    outwards = _unit(_sums(weights[:, None] * facing, owner, count))[owner]
    along_mm = offset_mm - np.einsum("pi,pi->p", offset_mm, outwards)[:, None] * outwards
    outward = -_unit(_sums(weights[:, None] * along_mm, owner, count))
    reach_mm = np.full(count, -float(bridge_mm))
    np.maximum.at(reach_mm, owner, np.einsum("pi,pi->p", along_mm, outward[owner]))
    return -reach_mm


def _sums(values: np.ndarray, owner: np.ndarray, count: int) -> np.ndarray:
    return np.stack([np.bincount(owner, values[:, axis], count) for axis in range(3)], axis=1)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), np.finfo(np.float64).tiny)


def vertex_normals(mesh: Mesh) -> Float64[np.ndarray, "v 3"]:
    """Compute the unit normal at each vertex, the mean over its triangles weighted by area.

    Parameters
    ----------
    mesh : Mesh
        Surface.

    Returns
    -------
    ndarray, shape (v, 3)
        Unit normals; zero at a vertex without triangles.
    """
    a, b, c = np.moveaxis(mesh.corners_mm, 1, 0)
    facing = np.repeat(np.cross(b - a, c - a), 3, axis=0)
    return _unit(_sums(facing, mesh.triangles.reshape(-1), len(mesh.vertices_mm)))


def clip(mesh: Mesh, values: Float64[np.ndarray, " v"], max_value: float = 0.0) -> Mesh:
    """Keep the part of a mesh where a function on its vertices does not exceed a value.

    Triangles across the border are cut on it, and neighbours share the new vertices, so the border is one
    line.

    Parameters
    ----------
    mesh : Mesh
        Surface.
    values : ndarray, shape (v,)
        Value of the function at each vertex; it is linear in between.
    max_value : float, optional
        Largest value that is kept.

    Returns
    -------
    Mesh
        The part that is kept.
    """
    return _cut(mesh, values, max_value)[0]


def _cut(mesh: Mesh, values: np.ndarray, max_value: float) -> tuple[Mesh, Int64[np.ndarray, "k 2"]]:
    """The part that is kept, and the edge of the mesh that each of its vertices lies on; a corner is one twice."""
    inside = values <= max_value
    count = inside[mesh.triangles].sum(axis=1)
    cut = (count == 1) | (count == 2)
    # Turn each cut triangle until its odd corner comes first: the one that is alone on its side.
    odd = np.where(count[cut] == 1, 1, 0)[:, None] == inside[mesh.triangles[cut]]
    turn = (odd.argmax(axis=1)[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(mesh.triangles[cut], turn, axis=1).T
    numbers, first = np.unique(edge_numbers(directed_edges(mesh), len(values)), return_index=True)
    ends = directed_edges(mesh)[first]
    crossed = inside[ends[:, 0]] != inside[ends[:, 1]]
    numbers, ends = numbers[crossed], ends[crossed]
    share = (max_value - values[ends[:, 0]]) / (values[ends[:, 1]] - values[ends[:, 0]])
    added_mm = mesh.vertices_mm[ends[:, 0]] + share[:, None] * (
        mesh.vertices_mm[ends[:, 1]] - mesh.vertices_mm[ends[:, 0]]
    )

    def on(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        wanted = edge_numbers(np.stack([one, other], axis=1), len(values))
        return len(values) + np.searchsorted(numbers, wanted)

    ab, ac = on(a, b), on(a, c)
    alone = count[cut] == 1
    triangles = np.concatenate(
        [
            mesh.triangles[count == 3],
            np.stack([a, ab, ac], axis=1)[alone],
            np.stack([ab, b, c], axis=1)[~alone],
            np.stack([ab, c, ac], axis=1)[~alone],
        ]
    )
    used, index = np.unique(triangles, return_inverse=True)
    vertices_mm = np.concatenate([mesh.vertices_mm, added_mm])[used]
    corners = np.repeat(np.arange(len(values))[:, None], 2, axis=1)
    kept = Mesh(vertices_mm, index.reshape(-1, 3).astype(np.int64))
    return kept, np.concatenate([corners, ends])[used].astype(np.int64)
