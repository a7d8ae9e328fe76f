"""Medial axis of a vessel: centres of inscribed spheres, from the Voronoi diagram of its surface's points."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.sparse import csr_array, triu
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay
from scipy.spatial.distance import cdist

from registration.centerline.vessel_walls import Walls
from registration.errors import InputError
from registration.geometry.mesh_topology import row_numbers
from registration.geometry.shapes import Mesh

# Share of their spacing by which points are jittered: vertices of a synthetic tube lie on common spheres, whose
# Delaunay tetrahedra have no volume and no circumcentre.
JOGGLE_SHARE = 1e-3
# Factor of the scale axis transform; above the square root of 2 it excludes the sheet into a square rim.
SCALE = 2.0
# Largest number of points of a wall, which bounds the memory: about a million tetrahedra of a kilobyte each.
MAX_POINTS = 120_000
# Largest number of spheres; where more fit inside, as in a thin wall, it is sampled by fewer points.
MAX_SPHERES = 150_000
# Spheres compared at a time, which bounds the memory.
BLOCK = 4096


@dataclass(frozen=True)
class MedialAxis:
    """Inscribed spheres of a vessel and which of them are neighbours.

    Parameters
    ----------
    centres_mm : ndarray, shape (n, 3)
        Centres in mm.
    radius_mm : ndarray, shape (n,)
        Radii in mm.
    apart_mm : csr_array, shape (n, n)
        Distances between neighbours in mm, each pair once.
    """

    centres_mm: Float64[np.ndarray, "n 3"]
    radius_mm: Float64[np.ndarray, " n"]
    apart_mm: csr_array

    @property
    def cost(self) -> csr_array:
        """Edges weighted by length over radius, whose cheapest paths keep to the middle."""
        pairs = self.apart_mm.tocoo()
        mean = 0.5 * (1 / self.radius_mm[pairs.row] + 1 / self.radius_mm[pairs.col])
        return csr_array((pairs.data * mean, (pairs.row, pairs.col)), shape=pairs.shape)

    @cached_property
    def shortcuts_mm(self) -> csr_array:
        """``apart_mm`` with straight edges to neighbours' neighbours whose spheres overlap by half.

        On a regular wall the neighbours form a grid, whose paths along the diagonal are too long.
        """
        linked = (self.apart_mm + self.apart_mm.T).astype(bool).astype(np.int32)
        pairs = triu(linked @ linked, 1).tocoo()
        lengths_mm = np.linalg.norm(self.centres_mm[pairs.row] - self.centres_mm[pairs.col], axis=1)
        inside = lengths_mm <= 0.5 * np.minimum(self.radius_mm[pairs.row], self.radius_mm[pairs.col])
        direct = self.apart_mm.tocoo()
        row = np.concatenate([np.minimum(direct.row, direct.col), pairs.row[inside]])
        column = np.concatenate([np.maximum(direct.row, direct.col), pairs.col[inside]])
        lengths_mm = np.maximum(np.concatenate([direct.data, lengths_mm[inside]]), 1e-9)
        # A pair that is linked both ways would count twice.
        chosen = np.unique(row.astype(np.int64) * len(self.radius_mm) + column, return_index=True)[1]
        return csr_array((lengths_mm[chosen], (row[chosen], column[chosen])), shape=pairs.shape)

    def is_main(self) -> Bool[np.ndarray, " n"]:
        """Find the spheres that belong to a vessel, and not to a spike into a roughness or a cap's rim.

        A sphere is excluded if a larger one contains it once both are ``SCALE`` times as large (scale axis
        transform). The larger ones are the largest in each of many small cubes.

        Returns
        -------
        ndarray of bool, shape (n,)
            Whether each sphere belongs to a vessel.

        References
        ----------
        J. Giesen, B. Miklos, M. Pauly and C. Wormser, SoCG 2009.
        """
        cube = np.floor(3 * self.centres_mm / self.radius_mm.max()).astype(np.int64)
        order = np.argsort(-self.radius_mm, kind="stable")
        large = order[np.unique(row_numbers(cube[order]), return_index=True)[1]]
        main = np.ones(len(self.radius_mm), dtype=bool)
        reach_mm = SCALE * float(self.radius_mm.max())
        for block in self._blocks(2 * reach_mm):
            low_mm, high_mm = self.centres_mm[block].min(axis=0), self.centres_mm[block].max(axis=0)
            places_mm = self.centres_mm[large]
            near = large[((places_mm > low_mm - reach_mm) & (places_mm < high_mm + reach_mm)).all(axis=1)]
            limit_mm = SCALE * (self.radius_mm[near] - self.radius_mm[block, None])
            main[block] = (cdist(self.centres_mm[block], self.centres_mm[near]) >= limit_mm).all(axis=1)
        return main

    def _blocks(self, side_mm: float) -> Iterator[Int64[np.ndarray, " b"]]:
        """All spheres, in blocks that lie in one cube each: what contains a sphere is near it."""
        cube = np.floor(self.centres_mm / side_mm).astype(np.int64)
        owner = row_numbers(cube)
        order = np.argsort(owner, kind="stable")
        for own in np.split(order, np.flatnonzero(np.diff(owner[order])) + 1):
            yield from np.array_split(own, 1 + len(own) // BLOCK)


def medial_axis(wall: Mesh, walls: Walls, size_mm: float) -> MedialAxis:
    """Compute the largest connected set of spheres that fit inside a vessel and touch points of its wall.

    Parameters
    ----------
    wall : Mesh
        Wall of the vessel.
    walls : Walls
        Distances to the wall, and what is inside.
    size_mm : float
        Radius of a typical vessel in mm, which the sampling of the wall follows.

    Returns
    -------
    MedialAxis
        The spheres.

    Raises
    ------
    InputError
        If no sphere fits inside.

    References
    ----------
    N. Amenta, S. Choi and R. K. Kolluri, Comput. Geom. 19, 2001; L. Antiga, B. Ene-Iordache and A. Remuzzi,
    IEEE TMI 22(5), 2003.
    """
    points_mm = sample_evenly(wall, size_mm)
    found = _spheres(points_mm, walls)
    while len(found.radius_mm) > MAX_SPHERES:
        share = 0.9 * MAX_SPHERES / len(found.radius_mm)
        points_mm = sample_evenly(wall, size_mm, max_points=int(share * len(points_mm)))
        found = _spheres(points_mm, walls)
    return found


def _spheres(points_mm: Float64[np.ndarray, "p 3"], walls: Walls) -> MedialAxis:
    cells = Delaunay(points_mm)
    corners_mm = points_mm[cells.simplices]
    centres_mm, radius_mm = _circumspheres(corners_mm)
    low_mm, high_mm = points_mm.min(axis=0), points_mm.max(axis=0)
    boxed = ((centres_mm > low_mm) & (centres_mm < high_mm)).all(axis=1)
    inside = np.zeros(len(centres_mm), dtype=bool)
    inside[boxed] = walls.inside(centres_mm[boxed])
    first = np.repeat(np.arange(len(centres_mm)), 4)
    second = cells.neighbors.ravel().astype(np.int64)
    linked = (second > first) & inside[first] & inside[second]
    first, second = first[linked], second[linked]
    clear = _stay_inside(centres_mm, radius_mm, first, second, walls)
    first, second = first[clear], second[clear]
    lengths_mm = np.maximum(np.linalg.norm(centres_mm[first] - centres_mm[second], axis=1), 1e-9)
    graph = csr_array((lengths_mm, (first, second)), shape=(len(centres_mm),) * 2)
    labels = connected_components(graph, directed=False)[1]
    kept = np.flatnonzero(inside & (labels == np.bincount(labels[inside], minlength=1).argmax()))
    if len(kept) < 2:
        raise InputError(f"surface: expected a vessel with an inside, received {len(kept)} inscribed spheres")
    return MedialAxis(centres_mm[kept], radius_mm[kept], graph[kept][:, kept])


def sample_evenly(
    mesh: Mesh, size_mm: float, coarse: float = 0.3, fine: float = 0.1, max_points: int | None = None
) -> Float64[np.ndarray, "p 3"]:
    """Sample points on a mesh with bounded spacing.

    Long triangles get points on a lattice; vertices are downsampled to one for each cube of the fine length,
    or of a longer one where too many would be left.

    Parameters
    ----------
    mesh : Mesh
        Surface.
    size_mm : float
        Radius of a typical vessel in mm.
    coarse : float, optional
        Largest distance of neighbouring points, as a share of ``size_mm``.
    fine : float, optional
        Edge of the cubes, as a share of ``size_mm``.
    max_points : int or None, optional
        Largest number of points; None for ``MAX_POINTS``.

    Returns
    -------
    ndarray, shape (p, 3)
        Points in mm, each moved at random by a small share of the spacing, always the same.
    """
    points_mm = np.concatenate([mesh.vertices_mm, *_lattices(mesh, coarse * size_mm)])
    chosen = _one_a_cube(points_mm, fine * size_mm)
    side_mm, max_points = fine * size_mm, MAX_POINTS if max_points is None else max_points
    while len(chosen) > max_points:
        # The number of points on a surface is inversely proportional to the square of their spacing.
        side_mm *= 1.1 * np.sqrt(len(chosen) / max_points)
        chosen = _one_a_cube(points_mm, side_mm)
    points_mm = points_mm[chosen]
    shake = np.random.default_rng(0).uniform(-1, 1, points_mm.shape)
    return points_mm + JOGGLE_SHARE * coarse * size_mm * shake


def _one_a_cube(points_mm: Float64[np.ndarray, "p 3"], side_mm: float) -> Int64[np.ndarray, " k"]:
    cube = np.floor((points_mm - points_mm.min(axis=0)) / side_mm).astype(np.int64)
    return np.unique(row_numbers(cube), return_index=True)[1].astype(np.int64)


def mean_radius_mm(mesh: Mesh) -> float:
    """Compute twice the enclosed volume over the area: for a tube, its radius.

    Parameters
    ----------
    mesh : Mesh
        Closed surface.

    Returns
    -------
    float
        Radius in mm.

    Raises
    ------
    InputError
        If the mesh is flat or empty.
    """
    a, b, c = np.moveaxis(mesh.corners_mm - mesh.vertices_mm.mean(axis=0), 1, 0)
    volume_mm3 = abs(float(np.einsum("ti,ti->t", a, np.cross(b, c)).sum())) / 6
    area_mm2 = float(mesh.areas_mm2.sum())
    if not (area_mm2 > 0 and volume_mm3 > 1e-6 * area_mm2**1.5):
        raise InputError(f"surface: expected one around a volume, received {volume_mm3:.3g} mm3 inside")
    return 2 * volume_mm3 / area_mm2


def _lattices(mesh: Mesh, max_edge_mm: float) -> list[Float64[np.ndarray, "p 3"]]:
    """Points inside triangles whose longest edge exceeds ``max_edge_mm``, on lattices fine enough."""
    corners_mm = mesh.corners_mm
    longest_mm = np.linalg.norm(corners_mm - np.roll(corners_mm, 1, axis=1), axis=2).max(axis=1)
    parts = np.ceil(longest_mm / max_edge_mm).astype(int)
    points: list[np.ndarray] = []
    for count in np.unique(parts[parts > 1]):
        i, j = np.meshgrid(np.arange(count + 1), np.arange(count + 1))
        i, j = i[i + j <= count], j[i + j <= count]
        shares = np.stack([i, j, count - i - j], axis=1) / count
        points.append((shares @ corners_mm[parts == count]).reshape(-1, 3))
    return points


def _circumspheres(
    corners_mm: Float64[np.ndarray, "n 4 3"],
) -> tuple[Float64[np.ndarray, "n 3"], Float64[np.ndarray, " n"]]:
    """Centre and radius of the sphere through each four points; NaN where they lie in a plane."""
    a, b, c = np.moveaxis(corners_mm[:, 1:] - corners_mm[:, :1], 1, 0)
    normal = np.cross(b, c)
    with np.errstate(divide="ignore", invalid="ignore"):
        offset_mm = (
            (a**2).sum(1)[:, None] * normal
            + (b**2).sum(1)[:, None] * np.cross(c, a)
            + (c**2).sum(1)[:, None] * np.cross(a, b)
        ) / (2 * np.einsum("ni,ni->n", a, normal))[:, None]
    return corners_mm[:, 0] + offset_mm, np.linalg.norm(offset_mm, axis=1)


def _stay_inside(
    centres_mm: np.ndarray, radius_mm: np.ndarray, first: np.ndarray, second: np.ndarray, walls: Walls
) -> Bool[np.ndarray, " e"]:
    """Whether the way between two centres stays inside; spheres that overlap by half need no look."""
    apart_mm = np.linalg.norm(centres_mm[first] - centres_mm[second], axis=1)
    clear = apart_mm <= 0.5 * np.minimum(radius_mm[first], radius_mm[second])
    far = np.flatnonzero(~clear)
    clear[far] = walls.inside(0.5 * (centres_mm[first[far]] + centres_mm[second[far]]))
    return np.asarray(clear)
