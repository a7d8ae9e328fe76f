"""Centerlines to files: a table, VTK's polylines, and curves that 3D Slicer opens; and the table read back."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np

from registration.errors import InputError
from registration.geometry.shapes import Centerline, Polyline
from registration.input_files import guarded
from registration.io.atomic import atomic_write, write_atomic
from registration.text_files import parse_number, read_text

COLUMNS = ("line", "x", "y", "z", "radius_mm")
MARKUPS_SCHEMA = (
    "https://raw.githubusercontent.com/Slicer/Slicer/main/Modules/Loadable/Markups/Resources/Schema/"
    "markups-schema-v1.0.3.json#"
)


def write_centerline(path: Path, centerline: Centerline, space: str = "LPS") -> None:
    """Write a centerline in the format that the suffix names.

    The polylines of ``.vtp`` carry their radius under the name that VMTK gives it, so that
    ``read_centerline`` reads them back. Positions are written as they are.

    Parameters
    ----------
    path : Path
        File ending in ``.csv`` (columns line, x, y, z, radius_mm), ``.vtp`` or ``.mrk.json``; its folder must
        exist.
    centerline : Centerline
        Lines in mm.
    space : {'LPS', 'RAS'}, optional
        Axes that the curves of ``.mrk.json`` name.

    Raises
    ------
    InputError
        If the suffix or a setting is another.
    """
    path = Path(path)
    if space not in ("LPS", "RAS"):
        raise InputError(f"space: expected LPS or RAS, received {space!r}")
    if path.name.lower().endswith(".mrk.json"):
        write_atomic(path, json.dumps(_markups(centerline, space), indent=1).encode())
    elif path.suffix.lower() == ".csv":
        write_atomic(path, _table(centerline).encode())
    elif path.suffix.lower() == ".vtp":
        _write_vtp(path, centerline)
    else:
        raise InputError(
            f"{path}: expected .csv, .vtp or .mrk.json to write, received {path.suffix or 'none'}"
        )


@guarded("a table of a centerline")
def read_centerline_table(path: Path) -> Centerline:
    """Read the table that ``write_centerline`` writes.

    Parameters
    ----------
    path : Path
        File with the columns line, x, y, z, radius_mm; the points of a line follow each other in order.

    Returns
    -------
    Centerline
        Lines in mm.

    Raises
    ------
    InputError
        If the file cannot be read, has other columns or rows that are no points, or lines are mixed.
    """
    rows = [row for row in csv.reader(read_text(path).splitlines()) if row]
    if not rows or tuple(entry.strip() for entry in rows[0]) != COLUMNS:
        received = ", ".join(rows[0]) if rows else "an empty file"
        raise InputError(f"{path}: expected the columns {', '.join(COLUMNS)}, received {received}")
    try:
        other = next((row for row in rows[1:] if len(row) != len(COLUMNS)), None)
        if other is not None:
            raise ValueError(f"the row {','.join(other)!r}")
        values = np.array([[parse_number(entry) for entry in row] for row in rows[1:]], dtype=np.float64)
        values = values.reshape(-1, len(COLUMNS))
    except ValueError as refusal:
        raise InputError(f"{path}: expected five numbers a row, received {refusal}") from refusal
    cuts = np.flatnonzero(np.diff(values[:, 0])) + 1
    try:
        return Centerline(
            tuple(Polyline(part[:, 1:4], part[:, 4]) for part in np.split(values, cuts) if len(part))
        )
    except InputError as refusal:
        raise InputError(f"{path}: {refusal}") from refusal


def _table(centerline: Centerline) -> str:
    rows = [",".join(COLUMNS)]
    for number, line in enumerate(centerline.lines):
        for point_mm, radius_mm in zip(line.points_mm, line.radius_mm, strict=True):
            rows.append(",".join([str(number), *(f"{value:.6f}" for value in (*point_mm, radius_mm))]))
    return "\n".join(rows) + "\n"


def _markups(centerline: Centerline, space: str) -> dict[str, Any]:
    curves = []
    for number, line in enumerate(centerline.lines):
        points = [
            {"id": str(place), "label": f"{place}", "position": position, "positionStatus": "defined"}
            for place, position in enumerate(line.points_mm.round(6).tolist())
        ]
        curves.append(
            {
                "type": "Curve",
                "name": f"centerline {number}",
                "coordinateSystem": space,
                "coordinateUnits": "mm",
                "locked": True,
                "controlPoints": points,
                "display": {"visibility": True, "pointLabelsVisibility": False, "glyphScale": 0.5},
            }
        )
    return {"@schema": MARKUPS_SCHEMA, "markups": curves}


def _write_vtp(path: Path, centerline: Centerline) -> None:
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

    places = vtkPoints()
    places.SetData(numpy_to_vtk(np.concatenate([line.points_mm for line in centerline.lines]), deep=True))
    sizes = [len(line.points_mm) for line in centerline.lines]
    lines = vtkCellArray()
    lines.SetData(
        numpy_to_vtkIdTypeArray(np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64), deep=True),
        numpy_to_vtkIdTypeArray(np.arange(sum(sizes), dtype=np.int64), deep=True),
    )
    data = vtkPolyData()
    data.SetPoints(places)
    data.SetLines(lines)
    radius = numpy_to_vtk(np.concatenate([line.radius_mm for line in centerline.lines]), deep=True)
    radius.SetName("MaximumInscribedSphereRadius")
    data.GetPointData().AddArray(radius)
    with atomic_write(path) as temporary:
        writer = vtkXMLPolyDataWriter()
        writer.SetFileName(str(temporary))
        writer.SetInputData(data)
        if not writer.Write():
            raise OSError(f"{path}: could not be written")
