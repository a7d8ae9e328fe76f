"""Data of a 3-D page: decimation of surfaces, bounds, and checks of finite values."""

from __future__ import annotations

import numpy as np

from experiments.errors import InputError
from registration.geometry.open3d_bridge import triangle_body
from registration.geometry.shapes import Mesh

# Collapsing edges one by one takes a minute for a million triangles: of so many times more than wanted, vertices are
# first merged by cubes.
QUADRIC_TIMES = 4


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
