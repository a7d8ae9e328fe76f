"""Data of a 3-D page: decimation of surfaces, bounds, and checks of finite values."""

from __future__ import annotations

import numpy as np

from experiments.errors import InputError
from registration.geometry.open3d_bridge import triangle_body
from registration.geometry.shapes import Mesh

# Collapsing edges one by one takes a minute for a million triangles: of so many times more than wanted, vertices are
# first merged by cubes.
QUADRIC_TIMES = 4
# Points are outliers, which the view is not fitted to, that lie farther from the median than this many times the
# distance that this share of the points keeps.
OUTLIER_TIMES, CORE_SHARE = 3.0, 0.95
# Unit vector that a view is taken from, and its distance in radii of the sphere around all that is in it.
VIEW_DIRECTION = np.array([1.7, -1.9, 0.8]) / np.linalg.norm([1.7, -1.9, 0.8])
VIEW_DISTANCE = 2.85
# It looks a little below the middle: the labels of the axes hang below the box.
VIEW_CENTER = {"x": 0.0, "y": 0.0, "z": -0.12}


def decimated(mesh: Mesh, values: np.ndarray | None, max_triangles: int) -> tuple[Mesh, np.ndarray | None]:
    """Decimate a mesh by edge collapse with quadric errors.

    Parameters
    ----------
    mesh : Mesh
        Surface in mm.
    values : ndarray, shape (v,), or None
        Values at the vertices.
    max_triangles : int
        Approximate largest number of triangles; a smaller mesh is returned unchanged.

    Returns
    -------
    mesh : Mesh
        The decimated surface.
    values : ndarray or None
        Values of the nearest vertices.

    References
    ----------
    M. Garland and P. S. Heckbert, SIGGRAPH 1997.
    """
    if len(mesh.triangles) <= max_triangles:
        return mesh, values
    from scipy.spatial import cKDTree

    body = triangle_body(mesh)
    if len(mesh.triangles) > QUADRIC_TIMES * max_triangles:
        # About as many cubes of this side as vertices that the rest of the way starts from.
        side_mm = float(np.sqrt(mesh.areas_mm2.sum() / (0.5 * QUADRIC_TIMES * max(max_triangles, 4))))
        body = body.simplify_vertex_clustering(side_mm)
    body = body.simplify_quadric_decimation(max(max_triangles, 4))
    fewer = Mesh(np.asarray(body.vertices, dtype=np.float64), np.asarray(body.triangles, dtype=np.int64))
    if values is None:
        return fewer, None
    return fewer, values[cKDTree(mesh.vertices_mm).query(fewer.vertices_mm)[1]]


def bounds_of(points_mm: np.ndarray) -> np.ndarray:
    """Compute the bounding box of points.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3)
        Points in mm.

    Returns
    -------
    ndarray, shape (2, 3)
        Lowest and highest coordinates in mm.
    """
    return np.stack([points_mm.min(axis=0), points_mm.max(axis=0)])


def core_bounds_of(points_mm: np.ndarray) -> tuple[np.ndarray, int]:
    """Compute the bounding box of points without those that lie far away from all others.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3)
        Points in mm.

    Returns
    -------
    bounds_mm : ndarray, shape (2, 3)
        Lowest and highest coordinates of the kept points in mm.
    outliers : int
        Number of points that lie more than three times as far from the median as 95 % of the points.
    """
    distance_mm = np.linalg.norm(points_mm - np.median(points_mm, axis=0), axis=1)
    core_mm = OUTLIER_TIMES * float(np.quantile(distance_mm, CORE_SHARE))
    # Where nearly all points are one point, there is no size to compare with.
    kept = distance_mm <= core_mm if core_mm > 0 else np.ones(len(points_mm), dtype=bool)
    return bounds_of(points_mm[kept]), int((~kept).sum())


def view_eye(extent_mm: np.ndarray) -> dict[str, float]:
    """Compute where a view is taken from, so far away that all of a box is in it.

    Parameters
    ----------
    extent_mm : ndarray, shape (3,)
        Sides of the box in mm, all above 0.

    Returns
    -------
    dict of str to float
        Coordinates x, y and z in plotly's scale, in which the box has a volume of 1.
    """
    box = extent_mm / np.cbrt(extent_mm.prod())
    place = VIEW_DIRECTION * VIEW_DISTANCE * float(np.linalg.norm(box)) / 2
    return dict(zip("xyz", map(float, place), strict=True))


def require_finite(name: str, points_mm: np.ndarray) -> None:
    """Require finite points.

    Parameters
    ----------
    name : str
        Name of the layer, for the message.
    points_mm : ndarray
        Points in mm, expected with shape (n, 3).

    Raises
    ------
    InputError
        If the shape differs or a coordinate is not finite.
    """
    if points_mm.ndim != 2 or points_mm.shape[1] != 3 or not np.isfinite(points_mm).all():
        raise InputError(
            f"{name}: expected finite points (n, 3), received an array of shape {points_mm.shape}"
        )


def require_values(name: str, values_mm: np.ndarray | None, count: int) -> None:
    """Require one finite value for each point, or no values at all.

    Parameters
    ----------
    name : str
        Name of the layer, for the message.
    values_mm : ndarray or None
        Values in mm.
    count : int
        Expected number.

    Raises
    ------
    InputError
        If the number differs or a value is not finite.
    """
    if values_mm is not None and (values_mm.shape != (count,) or not np.isfinite(values_mm).all()):
        raise InputError(
            f"{name}: expected {count} finite values, received an array of shape {values_mm.shape}"
        )
