"""Clouds of points with normals, and how a cloud without normals gets them."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TypeVar

import numpy as np
from jaxtyping import Float64, Int64
from scipy.spatial import cKDTree

from registration.brief import brief_repr
from registration.checks import require_positive
from registration.errors import InputError
from registration.geometry.open3d_bridge import import_open3d, point_body
from registration.geometry.shapes import require_cloud


@dataclass(frozen=True)
class OrientedCloud:
    """Points on a surface with their normals.

    Parameters
    ----------
    points_mm : ndarray, shape (p, 3)
        Points in mm.
    normals : ndarray, shape (p, 3)
        Unit normals that point out of the vessel.
    """

    points_mm: Float64[np.ndarray, "p 3"]
    normals: Float64[np.ndarray, "p 3"]

    __repr__ = brief_repr

    def __len__(self) -> int:
        return len(self.points_mm)


# Whatever kind of cloud goes in comes out.
AnyCloud = TypeVar("AnyCloud", bound=OrientedCloud)


def take(cloud: AnyCloud, index: Int64[np.ndarray, " k"]) -> AnyCloud:
    """Choose some points of a cloud, with all that is known of each of them.

    Parameters
    ----------
    cloud : OrientedCloud
        Cloud of any kind.
    index : ndarray, shape (k,)
        Indices of the points to keep.

    Returns
    -------
    OrientedCloud
        Cloud of the same kind with these points.
    """
    chosen = {
        entry.name: getattr(cloud, entry.name)[index]
        for entry in fields(cloud)
        if not entry.metadata.get("per_frame")
    }
    return replace(cloud, **chosen)


def require_oriented(cloud: OrientedCloud, min_points: int = 10) -> OrientedCloud:
    """Return a cloud, or raise InputError unless it spans a surface and every normal has length one.

    Parameters
    ----------
    cloud : OrientedCloud
        Cloud to check.
    min_points : int, optional
        Smallest number of points.

    Returns
    -------
    OrientedCloud
        The same cloud.

    Raises
    ------
    InputError
        If there are too few points, they span no surface, or a normal is off length one by 1e-3.
    """
    require_cloud(cloud.points_mm, "cloud", min_points)
    lengths = np.linalg.norm(cloud.normals, axis=1)
    broken = int((~(np.abs(lengths - 1) < 1e-3)).sum())
    if broken:
        raise InputError(f"cloud: expected normals of length one, received {broken} others")
    return cloud


def with_normals(points_mm: Float64[np.ndarray, "p 3"], neighbours: int = 30) -> OrientedCloud:
    """Estimate normals and turn them outwards, for a cloud that comes without any.

    Sides are made consistent along a spanning tree, then turned so that the cloud as a whole faces outwards.

    Parameters
    ----------
    points_mm : ndarray, shape (p, 3)
        Points in mm, at least ``neighbours``.
    neighbours : int, optional
        Number of points that each normal is estimated from.

    Returns
    -------
    OrientedCloud
        The points with unit normals.

    Raises
    ------
    InputError
        If there are too few points or they span no surface.

    References
    ----------
    H. Hoppe et al., SIGGRAPH 1992.
    """
    require_cloud(points_mm, "points_mm", neighbours)
    open3d = import_open3d()
    middle_mm = points_mm.mean(axis=0)
    body = point_body(points_mm - middle_mm)
    body.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(neighbours))
    body.orient_normals_consistent_tangent_plane(neighbours)
    normals = np.asarray(body.normals).copy()
    # The divergence theorem on a cloud of even density: the flux of the place itself is three volumes.
    if np.einsum("pi,pi->", points_mm - middle_mm, normals) < 0:
        normals = -normals
    return OrientedCloud(points_mm, normals)


def with_surface_normals(cloud: AnyCloud, reach_mm: float, max_neighbours: int = 40) -> AnyCloud:
    """Replace each normal by that of the plane through the points around it, on the side it pointed to.

    The normals of a contour lie in the image; those of the vessel lean out of it wherever the vessel narrows
    or runs obliquely. A plane is taken only where at least 6 points define it and its normal agrees with the
    old one within 60 deg; other normals stay.

    Parameters
    ----------
    cloud : OrientedCloud
        Cloud of any kind.
    reach_mm : float
        Radius of the neighbourhood in mm, above 0.
    max_neighbours : int, optional
        Largest number of neighbours used; more are thinned evenly.

    Returns
    -------
    OrientedCloud
        Cloud of the same kind with new normals.

    Raises
    ------
    InputError
        If ``reach_mm`` is not above 0.
    """
    require_positive("reach_mm", reach_mm)
    points_mm = cloud.points_mm
    # More neighbours than wanted are thinned evenly: the nearest ones alone would lie on one contour.
    near = cKDTree(points_mm).query_ball_point(points_mm, reach_mm, return_sorted=False)
    normals = cloud.normals.copy()
    sizes = np.array([len(found) for found in near])
    owner = np.repeat(np.arange(len(near)), np.minimum(sizes, max_neighbours))
    picked = np.concatenate([_thinned(found, max_neighbours) for found in near]).astype(np.int64)
    count = np.minimum(sizes, max_neighbours)
    offset_mm = points_mm[picked] - points_mm[owner]
    middle_mm = _sums(offset_mm, owner, len(near)) / count[:, None]
    offset_mm = offset_mm - middle_mm[owner]
    spread = _sums(np.einsum("pi,pj->pij", offset_mm, offset_mm).reshape(-1, 9), owner, len(near))
    values, vectors = np.linalg.eigh(spread.reshape(-1, 3, 3))
    fitted = vectors[:, :, 0]
    cosine = np.einsum("pi,pi->p", fitted, cloud.normals)
    flat = (count >= 6) & (values[:, 0] < 0.25 * values[:, 1]) & (np.abs(cosine) > 0.5)
    normals[flat] = fitted[flat] * np.sign(cosine[flat])[:, None]
    return replace(cloud, normals=normals)


def _thinned(found: list[int], max_neighbours: int) -> np.ndarray:
    if len(found) <= max_neighbours:
        return np.array(found, dtype=np.int64)
    return np.array(found, dtype=np.int64)[np.linspace(0, len(found) - 1, max_neighbours).astype(np.int64)]


def _sums(values: np.ndarray, owner: np.ndarray, count: int) -> np.ndarray:
    """Sum rows by owner; owners are sorted and each has at least one row."""
    starts = np.searchsorted(owner, np.arange(count))
    return np.add.reduceat(values, starts, axis=0)
