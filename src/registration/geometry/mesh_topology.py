"""Edges, borders and pieces of a triangle mesh, and how its holes are closed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

from registration.geometry.shapes import Mesh


@dataclass(frozen=True)
class Border:
    """One border of an open mesh.

    Parameters
    ----------
    edges : ndarray, shape (e, 2)
        Vertex indices along the surface's winding.
    centre_mm : ndarray, shape (3,)
        Middle of the border in mm.
    normal : ndarray, shape (3,)
        Unit normal of its mean plane, away from the vessel's inside.
    radius_mm : float
        Radius of a circle of its area in mm.
    facing : float
        Mean cosine, by area, between that normal and those of the two nearest rings of triangles: about 0
        around the open end of a tube, about 1 around a hole in its wall.
    """

    edges: Int64[np.ndarray, "e 2"]
    centre_mm: Float64[np.ndarray, "3"]
    normal: Float64[np.ndarray, "3"]
    radius_mm: float
    facing: float

    @property
    def is_end(self) -> bool:
        """Whether this is the open end of a tube and not a hole in a wall: the wall runs along its normal."""
        return self.facing < 0.5


def directed_edges(mesh: Mesh) -> Int64[np.ndarray, "e 2"]:
    """List the three edges of every triangle along its winding.

    Parameters
    ----------
    mesh : Mesh
        Mesh with t triangles.

    Returns
    -------
    ndarray, shape (3 t, 2)
        Vertex indices; triangle ``i`` has rows ``i``, ``t + i``, ``2 t + i``.
    """
    corners = mesh.triangles
    return np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])


def edge_numbers(edges: Int64[np.ndarray, "e 2"], vertices: int) -> Int64[np.ndarray, " e"]:
    """Number edges so that both directions of one edge have the same number.

    Parameters
    ----------
    edges : ndarray, shape (e, 2)
        Vertex indices.
    vertices : int
        Number of vertices.

    Returns
    -------
    ndarray, shape (e,)
        Number of each edge.
    """
    return edges.min(axis=1) * vertices + edges.max(axis=1)


def row_numbers(rows: Int64[np.ndarray, "n k"]) -> Int64[np.ndarray, " n"]:
    """Number rows of whole numbers so that equal rows have equal numbers, in the order of the rows.

    ``numpy.unique`` sorts numbers several times as fast as rows, with the same result.

    Parameters
    ----------
    rows : ndarray, shape (n, k)
        Cells of a grid, pairs of vertices and the like.

    Returns
    -------
    ndarray, shape (n,)
        Number of each row, from 0; compared like the rows, first column first.
    """
    if not len(rows):
        return np.zeros(0, dtype=np.int64)
    low, high = rows.min(axis=0).tolist(), rows.max(axis=0).tolist()
    sizes = [last - first + 1 for first, last in zip(low, high, strict=True)]
    if math.prod(sizes) > np.iinfo(np.int64).max:
        return np.unique(rows, axis=0, return_inverse=True)[1].reshape(-1)
    found = np.zeros(len(rows), dtype=np.int64)
    for column, first, size in zip(rows.T, low, sizes, strict=True):
        found = found * size + (column - first)
    return found


def pieces(mesh: Mesh) -> tuple[int, Int64[np.ndarray, " t"]]:
    """Find the connected pieces of a mesh.

    Parameters
    ----------
    mesh : Mesh
        Mesh with t triangles.

    Returns
    -------
    count : int
        Number of pieces.
    of_triangle : ndarray, shape (t,)
        Piece of every triangle.
    """
    edges = directed_edges(mesh)
    of_vertex = connected(edges, len(mesh.vertices_mm))[1]
    if not len(mesh.triangles):
        return 0, np.empty(0, dtype=np.int64)
    numbers, of_triangle = np.unique(of_vertex[mesh.triangles[:, 0]], return_inverse=True)
    return len(numbers), of_triangle.astype(np.int64)


def largest_piece(mesh: Mesh) -> Mesh:
    """Take the connected piece with most area.

    Parameters
    ----------
    mesh : Mesh
        Mesh of any number of pieces.

    Returns
    -------
    Mesh
        One piece; the mesh itself where it is one.
    """
    count, of_triangle = pieces(mesh)
    if count < 2:
        return mesh
    areas_mm2 = np.bincount(of_triangle, weights=mesh.areas_mm2)
    return keep_triangles(mesh, of_triangle == areas_mm2.argmax())


def keep_triangles(mesh: Mesh, kept: Bool[np.ndarray, " t"]) -> Mesh:
    """Take some triangles, without the vertices that none of them uses.

    Parameters
    ----------
    mesh : Mesh
        Mesh with t triangles.
    kept : ndarray of bool, shape (t,)
        Which triangles to keep.

    Returns
    -------
    Mesh
        Mesh of these triangles.
    """
    used, triangles = np.unique(mesh.triangles[kept], return_inverse=True)
    return Mesh(mesh.vertices_mm[used], triangles.reshape(-1, 3).astype(np.int64))


def borders(mesh: Mesh) -> tuple[Border, ...]:
    """Find all borders of a mesh.

    Parameters
    ----------
    mesh : Mesh
        Mesh, open or closed.

    Returns
    -------
    tuple of Border
        Borders, the widest first; none for a closed mesh.
    """
    edges = directed_edges(mesh)
    _, first, uses = np.unique(
        edge_numbers(edges, len(mesh.vertices_mm)), return_index=True, return_counts=True
    )
    single = first[uses == 1]
    if not len(single):
        return ()
    rim = edges[single]
    of_vertex = connected(rim, len(mesh.vertices_mm))[1]
    of_edge = np.unique(of_vertex[rim[:, 0]], return_inverse=True)[1]
    found = _borders_of(mesh, rim, of_edge)
    return tuple(sorted(found, key=lambda border: -border.radius_mm))


def with_caps(mesh: Mesh, chosen: tuple[Border, ...], rings: int = 1) -> Mesh:
    """Close chosen borders, each by a fan of triangles around its centre.

    Parameters
    ----------
    mesh : Mesh
        Open mesh.
    chosen : tuple of Border
        Borders to close.
    rings : int, optional
        Number of rings that each fan is cut into.

    Returns
    -------
    Mesh
        Mesh with the caps.
    """
    vertices, triangles = [mesh.vertices_mm], [mesh.triangles]
    count = len(mesh.vertices_mm)
    for border in chosen:
        rim, local = np.unique(border.edges, return_inverse=True)
        local = local.reshape(-1, 2)
        outer = rim
        for ring in range(1, rings):
            share = ring / rings
            vertices.append((1 - share) * mesh.vertices_mm[rim] + share * border.centre_mm)
            inner = count + np.arange(len(rim))
            count += len(rim)
            a, b, c, d = outer[local[:, 1]], outer[local[:, 0]], inner[local[:, 1]], inner[local[:, 0]]
            triangles += [np.stack([a, b, d], axis=1), np.stack([a, d, c], axis=1)]
            outer = inner
        vertices.append(border.centre_mm[None])
        middle = np.full(len(local), count)
        count += 1
        triangles.append(np.stack([outer[local[:, 1]], outer[local[:, 0]], middle], axis=1))
    return Mesh(np.concatenate(vertices), np.concatenate(triangles).astype(np.int64))


class TrianglesAt:
    """Find the triangles at vertices: looked up, as a rough mesh has hundreds of borders of a few edges each.

    Parameters
    ----------
    mesh : Mesh
        Mesh.
    """

    def __init__(self, mesh: Mesh) -> None:
        corners = mesh.triangles.reshape(-1)
        self._owner = np.argsort(corners, kind="stable") // 3
        self._last = np.cumsum(np.bincount(corners, minlength=len(mesh.vertices_mm)))
        self._uses = np.diff(self._last, prepend=0)

    def __call__(self, vertices: Int64[np.ndarray, " k"]) -> Int64[np.ndarray, " m"]:
        """Find the triangles that have one of some vertices.

        Parameters
        ----------
        vertices : ndarray of int, shape (k,)
            Indices of vertices.

        Returns
        -------
        ndarray of int, shape (m,)
            Indices of the triangles, each once, in their order.
        """
        uses = self._uses[vertices]
        # The places of each vertex in the list of owners, one run after the other.
        places = np.repeat(self._last[vertices] - np.cumsum(uses), uses) + np.arange(uses.sum())
        return np.unique(self._owner[places])


def _borders_of(mesh: Mesh, rim: np.ndarray, of_edge: np.ndarray) -> list[Border]:
    """The borders that edges belong to, all at once: a rough mesh has thousands, of a few edges each."""
    count = int(of_edge.max()) + 1
    start_mm, end_mm = mesh.vertices_mm[rim[:, 0]], mesh.vertices_mm[rim[:, 1]]
    length_mm = np.linalg.norm(end_mm - start_mm, axis=1)
    total_mm = np.maximum(np.bincount(of_edge, length_mm, count), np.finfo(np.float64).tiny)
    # Weighted by length, so that a stretch with many short edges pulls no harder than one with few long ones.
    weights = length_mm / total_mm[of_edge]
    centre_mm = sums_of_owners(weights[:, None] * (0.5 * (start_mm + end_mm)), of_edge, count)
    # The cap runs against the wall's winding.
    middle_mm = centre_mm[of_edge]
    area_mm2 = 0.5 * sums_of_owners(np.cross(end_mm - middle_mm, start_mm - middle_mm), of_edge, count)
    size_mm2 = np.linalg.norm(area_mm2, axis=1)
    normal = area_mm2 / np.maximum(size_mm2, np.finfo(np.float64).tiny)[:, None]
    facing = _facing(mesh, rim, of_edge, normal)
    edges = np.split(rim[np.argsort(of_edge, kind="stable")], np.cumsum(np.bincount(of_edge))[:-1])
    radius_mm = np.sqrt(size_mm2 / np.pi).tolist()
    return [Border(*each) for each in zip(edges, centre_mm, normal, radius_mm, facing.tolist(), strict=True)]


def _facing(mesh: Mesh, rim: np.ndarray, of_edge: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """How far the wall within two rings of each border faces along the border's normal, from -1 to 1."""
    vertices, triangles = len(mesh.vertices_mm), len(mesh.triangles)
    corners = np.repeat(np.arange(triangles), 3)
    at = csr_array(
        (np.ones(3 * triangles, dtype=bool), (mesh.triangles.reshape(-1), corners)), (vertices, triangles)
    )
    both = np.repeat(of_edge, 2)
    on_rim = csr_array((np.ones(len(both), dtype=bool), (both, rim.reshape(-1))), (len(normal), vertices))
    near = csr_array(csr_array(on_rim @ at) @ at.T) @ at
    near.sum_duplicates()
    border = np.repeat(np.arange(len(normal)), np.diff(near.indptr))
    # By area, so that slivers left by a cut do not speak for the wall.
    a, b, c = np.moveaxis(mesh.vertices_mm[mesh.triangles[near.indices]], 1, 0)
    walls = np.cross(b - a, c - a)
    along = np.bincount(border, np.einsum("wi,wi->w", walls, normal[border]), len(normal))
    return along / np.maximum(np.bincount(border, np.linalg.norm(walls, axis=1), len(normal)), 1e-300)


def sums_of_owners(
    values: Float64[np.ndarray, "n 3"], owner: Int64[np.ndarray, " n"], count: int
) -> Float64[np.ndarray, "{count} 3"]:
    """Add up the vectors of each owner.

    Parameters
    ----------
    values : ndarray, shape (n, 3)
        Vectors.
    owner : ndarray of int, shape (n,)
        Whose each is, from 0.
    count : int
        Number of owners.

    Returns
    -------
    ndarray, shape (count, 3)
        Sum of each owner, zero where it has none.
    """
    return np.stack([np.bincount(owner, values[:, axis], count) for axis in range(3)], axis=1)


def connected(edges: Int64[np.ndarray, "e 2"], vertices: int) -> tuple[int, Int64[np.ndarray, " {vertices}"]]:
    """Find the sets of vertices that hang together by edges.

    Parameters
    ----------
    edges : ndarray, shape (e, 2)
        Vertex indices.
    vertices : int
        Number of vertices.

    Returns
    -------
    count : int
        Number of sets.
    of_vertex : ndarray, shape (vertices,)
        Set of every vertex.
    """
    ones = np.ones(len(edges), dtype=np.int8)
    count, labels = connected_components(
        coo_array((ones, edges.T), shape=(vertices, vertices)), directed=False
    )
    return int(count), labels.astype(np.int64)
