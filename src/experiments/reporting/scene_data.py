"""Data for pages of plotly.js: decimation of surfaces, binary arrays, and checks of finite values."""

from __future__ import annotations

import base64

import numpy as np

from experiments.errors import InputError
from registration.geometry.open3d_bridge import triangle_body
from registration.geometry.shapes import Mesh

# Collapsing edges one by one takes a minute for a million triangles: of so many times more than wanted, vertices are
# first merged by cubes.
QUADRIC_TIMES = 4


def thinned(mesh: Mesh, values: np.ndarray | None, most: int) -> tuple[Mesh, np.ndarray | None]:
    """Decimate a mesh by edge collapse with quadric errors.

    Parameters
    ----------
    mesh : Mesh
        Surface in mm.
    values : ndarray, shape (v,), or None
        Values at the vertices.
    most : int
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
    if len(mesh.triangles) <= most:
        return mesh, values
    from scipy.spatial import cKDTree

    body = triangle_body(mesh)
    if len(mesh.triangles) > QUADRIC_TIMES * most:
        # About as many cubes of this side as vertices that the rest of the way starts from.
        side_mm = float(np.sqrt(mesh.areas_mm2.sum() / (0.5 * QUADRIC_TIMES * max(most, 4))))
        body = body.simplify_vertex_clustering(side_mm)
    body = body.simplify_quadric_decimation(max(most, 4))
    thin = Mesh(np.asarray(body.vertices, dtype=np.float64), np.asarray(body.triangles, dtype=np.int64))
    if values is None:
        return thin, None
    return thin, values[cKDTree(mesh.vertices_mm).query(thin.vertices_mm)[1]]


def packed(values: np.ndarray, kind: str) -> dict[str, str]:
    """Encode an array as plotly.js takes it in binary, a third of the size of text.

    Parameters
    ----------
    values : ndarray
        Numbers.
    kind : str
        NumPy type code without byte order, such as ``f4``.

    Returns
    -------
    dict of str to str
        Type and base64 data.
    """
    raw = np.ascontiguousarray(values, dtype=f"<{kind}").tobytes()
    return {"dtype": kind, "bdata": base64.b64encode(raw).decode("ascii")}


def packed_places(points_mm: np.ndarray) -> dict[str, dict[str, str]]:
    """Encode points in single precision.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3)
        Points in mm.

    Returns
    -------
    dict of str to dict
        Encoded x, y and z.
    """
    return {axis: packed(points_mm[:, at], "f4") for at, axis in enumerate("xyz")}


def packed_index(index: np.ndarray) -> dict[str, str]:
    """Encode indices of vertices in as few bytes as they need.

    Parameters
    ----------
    index : ndarray of int
        Indices.

    Returns
    -------
    dict of str to str
        Type and base64 data.
    """
    return packed(index, "u2" if index.max(initial=0) < 1 << 16 else "u4")


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
