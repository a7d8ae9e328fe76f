"""Polygons of any number of corners, as files hold them, checked and cut into triangles."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float64, Int64

from registration.errors import InputError


@dataclass(frozen=True)
class Polygons:
    """Points as a file has them, and polygons over them.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Points in the file's unit.
    corners : ndarray, shape (c,), optional
        Indices of all polygons' corners one after the other; those of polygon ``i`` are ``corners[offsets[i]
        : offsets[i + 1]]``.
    offsets : ndarray, shape (p + 1,), optional
        Where each polygon begins, the first at 0.
    """

    points: Float64[np.ndarray, "n 3"]
    corners: Int64[np.ndarray, " c"] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    offsets: Int64[np.ndarray, " o"] = field(default_factory=lambda: np.zeros(1, dtype=np.int64))

    def triangles(self) -> Int64[np.ndarray, "t 3"]:
        """Cut the polygons into triangles; those of fewer than three corners are lines and left out.

        Returns
        -------
        ndarray, shape (t, 3)
            Indices of corners.

        Raises
        ------
        InputError
            If a corner is no point, before any library is asked to follow it.
        """
        if len(self.corners) and not (0 <= self.corners.min() and self.corners.max() < len(self.points)):
            raise InputError(
                f"triangles: expected indices from 0 to {len(self.points) - 1}, "
                f"received {self.corners.min()} to {self.corners.max()}"
            )
        sizes = np.diff(self.offsets)
        if (sizes == 3).all():
            return self.corners.reshape(-1, 3)
        keep = sizes >= 3
        corners = self.corners[np.repeat(keep, sizes)]
        offsets = np.concatenate([[0], np.cumsum(sizes[keep])]).astype(np.int64)
        return _cut(self.points, corners, offsets)


def joined(rows: list[list[int]]) -> tuple[Int64[np.ndarray, " c"], Int64[np.ndarray, " o"]]:
    """Join polygons given one by one.

    Parameters
    ----------
    rows : list of list of int
        Corners of each polygon.

    Returns
    -------
    corners : ndarray, shape (c,)
        Corners one after the other.
    offsets : ndarray, shape (p + 1,)
        Where each polygon begins.
    """
    corners = np.array([corner for row in rows for corner in row], dtype=np.int64)
    return corners, np.concatenate([[0], np.cumsum([len(row) for row in rows])]).astype(np.int64)


def _cut(points: np.ndarray, corners: np.ndarray, offsets: np.ndarray) -> Int64[np.ndarray, "t 3"]:
    """Triangles by VTK's ear clipping, which concave polygons need."""
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
    from vtkmodules.vtkFiltersCore import vtkTriangleFilter

    places, faces, data = vtkPoints(), vtkCellArray(), vtkPolyData()
    places.SetData(numpy_to_vtk(np.ascontiguousarray(points), deep=True))
    faces.SetData(numpy_to_vtkIdTypeArray(offsets, deep=True), numpy_to_vtkIdTypeArray(corners, deep=True))
    data.SetPoints(places)
    data.SetPolys(faces)
    cutter: Any = vtkTriangleFilter()
    cutter.SetInputData(data)
    cutter.PassLinesOff()
    cutter.PassVertsOff()
    cutter.Update()
    connectivity = cutter.GetOutput().GetPolys().GetConnectivityArray()
    return vtk_to_numpy(connectivity).astype(np.int64).reshape(-1, 3)
