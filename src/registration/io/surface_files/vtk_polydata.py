"""VTK's surfaces: XML (.vtp) and the older format (.vtk), where unstructured grids of polygons are surfaces too."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from registration.errors import InputError
from registration.input_files import guarded
from registration.io.surface_files.polygons import Polygons
from registration.io.surface_files.vtk_legacy import require_whole_legacy
from registration.io.surface_files.vtk_xml import require_whole_xml

SUFFIXES = (".vtp", ".vtk")


@guarded("a VTK surface")
def read_polydata(path: Path) -> Any:
    """Read a VTK file, every cell of which has points that are there.

    Parameters
    ----------
    path : Path
        File ending in ``.vtp`` or ``.vtk``.

    Returns
    -------
    vtkPolyData
        VTK's own object.

    Raises
    ------
    InputError
        If the file is broken or cut short, or holds no surface.
    """
    if path.suffix.lower() != ".vtk":
        require_whole_xml(path)
    reader: Any = _legacy_reader(path) if path.suffix.lower() == ".vtk" else _xml_reader()
    errors: list[str] = []
    reader.SetFileName(str(path))
    # An observer also keeps VTK's own report off the terminal. What is cut short may be but a warning.
    observed: list[Any] = [reader]
    if hasattr(reader, "GetReaderErrorObserver") and reader.GetReaderErrorObserver() is not None:
        observed.append(reader.GetReaderErrorObserver())
    for source in observed:
        for event in ("ErrorEvent", "WarningEvent"):
            source.AddObserver(event, lambda *_: errors.append("error"))
    reader.Update()
    data = reader.GetOutputDataObject(0)
    if errors or reader.GetErrorCode() or data is None:
        raise InputError(
            f"{path}: expected a complete {path.suffix[1:].upper()} file, received one that cannot be read"
        )
    if data.IsA("vtkUnstructuredGrid"):
        _require_points(path, data.GetCells(), data.GetNumberOfPoints())
        data = _boundary(data)
    for cells in (data.GetVerts(), data.GetLines(), data.GetPolys(), data.GetStrips()):
        _require_points(path, cells, data.GetNumberOfPoints())
    return data


def read_vtk_surface(path: Path) -> Polygons:
    """Read polygons and triangle strips of a VTK file; lines and single points are left out.

    Parameters
    ----------
    path : Path
        File ending in ``.vtp`` or ``.vtk``.

    Returns
    -------
    Polygons
        Points and polygons.
    """
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkFiltersCore import vtkTriangleFilter

    cutter = vtkTriangleFilter()
    cutter.SetInputData(read_polydata(path))
    cutter.PassLinesOff()
    cutter.PassVertsOff()
    cutter.Update()
    data = cutter.GetOutput()
    if not data.GetNumberOfPoints():
        return Polygons(np.empty((0, 3)))
    corners = vtk_to_numpy(data.GetPolys().GetConnectivityArray()).astype(np.int64)
    points = vtk_to_numpy(data.GetPoints().GetData()).astype(np.float64)
    return Polygons(points, corners, 3 * np.arange(len(corners) // 3 + 1, dtype=np.int64))


def _xml_reader() -> Any:
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

    return vtkXMLPolyDataReader()


def _legacy_reader(path: Path) -> Any:
    """The reader for the kind of data that the file holds; the one for all kinds keeps its errors to itself."""
    from vtkmodules.vtkIOLegacy import vtkPolyDataReader, vtkUnstructuredGridReader

    kind = require_whole_legacy(path)
    return vtkPolyDataReader() if kind == "POLYDATA" else vtkUnstructuredGridReader()


def _boundary(grid: Any) -> Any:
    """The polygons of a grid, and the outer faces of its volumes."""
    from vtkmodules.vtkFiltersGeometry import vtkGeometryFilter

    outer = vtkGeometryFilter()
    outer.SetInputData(grid)
    outer.Update()
    return outer.GetOutput()


def _require_points(path: Path, cells: Any, points: int) -> None:
    from vtkmodules.util.numpy_support import vtk_to_numpy

    if cells is None:
        raise InputError(f"{path}: expected cells over its points, received a file that cannot be read")
    if not cells.GetNumberOfConnectivityIds():
        return
    index = vtk_to_numpy(cells.GetConnectivityArray())
    if not (0 <= index.min() and index.max() < points):
        raise InputError(
            f"{path}: triangles: expected indices from 0 to {points - 1}, received {index.min()} to {index.max()}"
        )
