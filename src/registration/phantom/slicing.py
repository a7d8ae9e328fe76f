"""The exact mask of a frame: the closed surface cut by the image plane, filled at pixel centres."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Float64, Int

from registration.geometry.shapes import Mesh


def cut(
    vertices: Float[np.ndarray, "v 3"], triangles: Int[np.ndarray, "t 3"]
) -> Float64[np.ndarray, "s 2 2"]:
    """Cut a triangle surface by the plane where the third coordinate is 0.

    Parameters
    ----------
    vertices : ndarray, shape (v, 3)
        Vertices, third coordinate perpendicular to the plane.
    triangles : ndarray of int, shape (t, 3)
        Vertex indices of each triangle.

    Returns
    -------
    ndarray, shape (s, 2, 2)
        Segments (start, end) in the first two coordinates, consistently directed, so that those of a closed
        surface chain into closed loops. A vertex in the plane counts as above it: every loop stays closed.
    """
    height = vertices[:, 2]
    above = (height >= 0.0)[triangles]
    crossing = triangles[(above[:, 0] != above[:, 1]) | (above[:, 1] != above[:, 2])]
    if not len(crossing):
        return np.empty((0, 2, 2))
    above = height[crossing] >= 0.0
    one_above = above.sum(axis=1) == 1
    alone = np.where(one_above, above.argmax(axis=1), (~above).argmax(axis=1))
    order = (alone[:, None] + np.arange(3)) % 3
    apex, second, third = np.take_along_axis(crossing, order, axis=1).T
    start, end = _on_plane(vertices, apex, second), _on_plane(vertices, apex, third)
    return np.stack(
        [np.where(one_above[:, None], start, end), np.where(one_above[:, None], end, start)], axis=1
    )


def rasterise(
    segments_px: Float[np.ndarray, "s 2 2"], height_px: int, width_px: int
) -> Bool[np.ndarray, "height_px width_px"]:
    """Fill closed directed loops by the non-zero winding rule at pixel centres.

    Overlapping loops of one direction give their union.

    Parameters
    ----------
    segments_px : ndarray, shape (s, 2, 2)
        Start and end of each segment as (column, row) in px; pixel centres lie at whole numbers.
    height_px, width_px : int
        Size of the mask in px.

    Returns
    -------
    ndarray of bool, shape (height_px, width_px)
        Mask of the interior.
    """
    start, end = segments_px[:, 0], segments_px[:, 1]
    low = np.ceil(np.minimum(start[:, 1], end[:, 1])).astype(np.int64)
    high = np.ceil(np.maximum(start[:, 1], end[:, 1])).astype(np.int64)
    low, high = np.clip(low, 0, height_px), np.clip(high, 0, height_px)
    rows_each = high - low
    which = np.repeat(np.arange(len(segments_px)), rows_each)
    row = low[which] + np.arange(len(which)) - np.repeat(np.cumsum(rows_each) - rows_each, rows_each)
    rise = end[which, 1] - start[which, 1]
    share = (row - start[which, 1]) / rise
    column = start[which, 0] + share * (end[which, 0] - start[which, 0])
    winding = np.zeros((height_px, width_px + 1), dtype=np.int32)
    first_inside = np.clip(np.ceil(column), 0, width_px).astype(np.int64)
    np.add.at(winding, (row, first_inside), np.where(rise > 0, 1, -1))
    return np.cumsum(winding, axis=1)[:, :width_px] != 0


def section(segments_mm: Float[np.ndarray, "s 2 2"]) -> tuple[float, tuple[float, float]]:
    """Compute the area and the centroid inside closed directed loops.

    Parameters
    ----------
    segments_mm : ndarray, shape (s, 2, 2)
        Start and end of each segment in mm.

    Returns
    -------
    area_mm2 : float
        Area in mm2; 0 without loops.
    centroid_mm : tuple[float, float]
        Centroid in mm; the origin without loops.
    """
    (x0, y0), (x1, y1) = segments_mm[:, 0].T, segments_mm[:, 1].T
    twice = x0 * y1 - x1 * y0
    area_mm2 = 0.5 * float(twice.sum())
    if abs(area_mm2) < 1e-9:
        return 0.0, (0.0, 0.0)
    centroid = float(((x0 + x1) * twice).sum()), float(((y0 + y1) * twice).sum())
    return abs(area_mm2), (centroid[0] / (6.0 * area_mm2), centroid[1] / (6.0 * area_mm2))


def mask_of_plane(
    mesh: Mesh, pixel_A_mesh: Float[np.ndarray, "4 4"], height_px: int, width_px: int
) -> Bool[np.ndarray, "height_px width_px"]:
    """Compute the mask of the image that a mesh gives in a plane.

    Parameters
    ----------
    mesh : Mesh
        Closed surface.
    pixel_A_mesh : ndarray, shape (4, 4)
        Affine matrix from the mesh's frame to (column, row, out of plane, 1).
    height_px, width_px : int
        Size of the mask in px.

    Returns
    -------
    ndarray of bool, shape (height_px, width_px)
        Mask of the interior.
    """
    vertices = mesh.vertices_mm @ pixel_A_mesh[:3, :3].T + pixel_A_mesh[:3, 3]
    return rasterise(cut(vertices, mesh.triangles), height_px, width_px)


def _on_plane(
    vertices: Float[np.ndarray, "v 3"], first: Int[np.ndarray, " s"], second: Int[np.ndarray, " s"]
) -> Float64[np.ndarray, "s 2"]:
    # Ordering each edge's ends by index makes the two triangles that share it compute the same point bit by bit.
    lower, upper = np.minimum(first, second), np.maximum(first, second)
    a, b = vertices[lower].astype(np.float64), vertices[upper].astype(np.float64)
    share = a[:, 2] / (a[:, 2] - b[:, 2])
    return a[:, :2] + share[:, None] * (b[:, :2] - a[:, :2])
