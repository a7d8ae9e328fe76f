"""Open ends of a closed reconstruction, cut where the measured points end.

A Poisson surface is closed: it bulges out of every open end. Cutting by the density of points removes wall
and bulge alike. Here the surface is cut along the line where the measured points end.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.sparse import coo_array, csr_array, eye_array
from scipy.spatial import cKDTree

from registration.checks import require_positive
from registration.geometry.mesh_topology import (
    TrianglesAt,
    borders,
    connected,
    directed_edges,
    edge_numbers,
    sums_of_owners,
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
    members = np.flatnonzero(out)
    members = members[np.argsort(piece[members], kind="stable")]
    pieces = [own for own in np.split(members, np.flatnonzero(np.diff(piece[members])) + 1) if len(own)]
    for own, hole in zip(pieces, _Surroundings(mesh, edges).holes(pieces, past_mm, bridge_mm), strict=True):
        if hole:
            past_mm[own] = -SHALLOW_MM
    return clip(mesh, past_mm)


class _Surroundings:
    """Neighbourhoods of a mesh, so that a hole is judged in its own: rough masks leave thousands of them.

    Parameters
    ----------
    mesh : Mesh
        Surface.
    edges : ndarray of int, shape (e, 2)
        Its directed edges.
    """

    def __init__(self, mesh: Mesh, edges: Int64[np.ndarray, "e 2"]) -> None:
        self.mesh = mesh
        count = len(mesh.vertices_mm)
        neighbours = coo_array((np.ones(len(edges), dtype=bool), edges.T), shape=(count, count)).tocsr()
        # With the vertex itself, so that a step outwards keeps what was reached before.
        self.reached = csr_array(neighbours + neighbours.T + eye_array(count, dtype=bool, format="csr"))
        self.triangles_at = TrianglesAt(mesh)

    def holes(
        self, pieces: Sequence[Int64[np.ndarray, " _"]], past_mm: Float64[np.ndarray, " v"], bridge_mm: float
    ) -> Bool[np.ndarray, " p"]:
        """Tell which pieces close a narrow hole in the middle of a wall.

        Parameters
        ----------
        pieces : sequence of ndarray of int
            Indices of the vertices of each of p pieces, which share none.
        past_mm : ndarray, shape (v,)
            How far each vertex of the mesh lies past the points, in mm.
        bridge_mm : float
            Largest radius in mm of such a hole.

        Returns
        -------
        ndarray of bool, shape (p,)
            False for an open end, and for what reaches the border of the mesh.
        """
        own = _memberships(pieces, len(past_mm))
        inner = own
        for _ in range(RINGS - 1):
            inner = csr_array(inner @ self.reached)
        within = csr_array(inner @ self.reached)
        found = np.ones(len(pieces), dtype=bool)
        # Pieces far apart are judged at once: each by what lies around itself, as if there were no other.
        for together in _apart(csr_array(within @ within.T)):
            found[together] = self._holes_apart(
                own[together], inner[together], within[together], past_mm, bridge_mm
            )
        return found

    def _holes_apart(
        self, own: csr_array, inner: csr_array, within: csr_array, past_mm: np.ndarray, bridge_mm: float
    ) -> np.ndarray:
        """The same of pieces whose neighbourhoods share no vertex."""
        owner = np.full(len(past_mm), -1)
        owner[within.indices] = np.repeat(np.arange(within.shape[0]), np.diff(within.indptr))
        outer = np.setdiff1d(within.indices, inner.indices)
        used, corners = np.unique(self.mesh.triangles[self.triangles_at(inner.indices)], return_inverse=True)
        part = Mesh(self.mesh.vertices_mm[used], corners.reshape(-1, 3).astype(np.int64))
        is_own = np.isin(used, own.indices)
        values = np.where(is_own, past_mm[used], np.minimum(past_mm[used], -SHALLOW_MM))
        cut, ends = _cut(part, values, 0.0)
        # Where the part itself ends is no border of the surface.
        outermost, touching = (some[ends].any(axis=1) for some in (np.isin(used, outer), is_own))
        found = np.ones(within.shape[0], dtype=bool)
        for rim in borders(cut):
            if not outermost[rim.edges].any():
                stays = not rim.is_end and rim.radius_mm <= bridge_mm
            else:  # where it touches the piece, that goes on along the border of the mesh
                stays = not touching[rim.edges].any()
            if not stays:
                found[owner[used[ends[rim.edges[0, 0], 0]]]] = False
        return found


def _memberships(pieces: Sequence[np.ndarray], count: int) -> csr_array:
    """Which of ``count`` vertices each piece has."""
    lengths = [len(own) for own in pieces]
    indices = np.concatenate([*pieces, np.empty(0, dtype=np.int64)])
    starts = np.concatenate([[0], np.cumsum(lengths, dtype=np.int64)])
    return csr_array((np.ones(len(indices), dtype=bool), indices, starts), shape=(len(pieces), count))


def _apart(meets: csr_array) -> list[np.ndarray]:
    """Groups of pieces of which no two meet: each piece joins the first group that has none of those it meets."""
    group = np.full(meets.shape[0], -1)
    for piece in range(len(group)):
        taken = set(group[meets.indices[meets.indptr[piece] : meets.indptr[piece + 1]]].tolist())
        group[piece] = next(number for number in itertools.count() if number not in taken)
    return [np.flatnonzero(group == number) for number in range(group.max(initial=-1) + 1)]


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
    outwards = _unit(sums_of_owners(weights[:, None] * facing, owner, count))[owner]
    along_mm = offset_mm - np.einsum("pi,pi->p", offset_mm, outwards)[:, None] * outwards
    outward = -_unit(sums_of_owners(weights[:, None] * along_mm, owner, count))
    reach_mm = np.full(count, -float(bridge_mm))
    np.maximum.at(reach_mm, owner, np.einsum("pi,pi->p", along_mm, outward[owner]))
    return -reach_mm


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
    return _unit(sums_of_owners(facing, mesh.triangles.reshape(-1), len(mesh.vertices_mm)))


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
