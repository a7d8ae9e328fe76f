"""Numbers for a page of plotly.js: surfaces thinned, arrays in binary, and checks that all of it is finite."""

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
    """Collapse edges by quadric error (Garland and Heckbert, SIGGRAPH 1997); values come from the nearest vertex."""
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
    """Numbers as plotly.js takes them in binary: a third of the size of text."""
    raw = np.ascontiguousarray(values, dtype=f"<{kind}").tobytes()
    return {"dtype": kind, "bdata": base64.b64encode(raw).decode("ascii")}


def packed_places(points_mm: np.ndarray) -> dict[str, dict[str, str]]:
    """Points (n, 3) as x, y and z in single precision."""
    return {axis: packed(points_mm[:, at], "f4") for at, axis in enumerate("xyz")}


def packed_index(index: np.ndarray) -> dict[str, str]:
    """Numbers of vertices in as few bytes as hold them."""
    return packed(index, "u2" if index.max(initial=0) < 1 << 16 else "u4")


def bounds_of(points_mm: np.ndarray) -> np.ndarray:
    """Lowest and highest coordinates (2, 3)."""
    return np.stack([points_mm.min(axis=0), points_mm.max(axis=0)])


def require_finite(name: str, points_mm: np.ndarray) -> None:
    """Raise InputError unless the points are finite and (n, 3)."""
    if points_mm.ndim != 2 or points_mm.shape[1] != 3 or not np.isfinite(points_mm).all():
        raise InputError(
            f"{name}: expected finite points (n, 3), received an array of shape {points_mm.shape}"
        )


def require_values(name: str, values_mm: np.ndarray | None, count: int) -> None:
    """Raise InputError unless there are ``count`` finite values, or none at all."""
    if values_mm is not None and (values_mm.shape != (count,) or not np.isfinite(values_mm).all()):
        raise InputError(
            f"{name}: expected {count} finite values, received an array of shape {values_mm.shape}"
        )
