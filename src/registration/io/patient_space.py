"""Surfaces in patient space: the axes that a file names, and files written with the names of theirs.

A mesh holds numbers, not axes. 3D Slicer writes SPACE=LPS or SPACE=RAS into the header of STL, the comments of PLY and
OBJ, the title of VTK and a field of VTP files (its vtkMRMLModelStorageNode), and obeys it when it reads; so does this
module.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64

from registration.errors import InputError
from registration.geometry.shapes import Mesh, Surface, points_of
from registration.input_files import guarded
from registration.io.atomic import atomic_write
from registration.io.surface_files.stl import is_text
from registration.io.surface_files.vtk_polydata import read_polydata

WRITABLE = (".ply", ".stl", ".vtp")
_STATED = re.compile(rb"SPACE=(LPS|RAS)")
_HEADER_BYTES = 1 << 14


@guarded("a surface")
def stated_space(path: Path) -> str | None:
    """Find out which axes the header of a mesh's file names.

    Parameters
    ----------
    path : Path
        File of a mesh.

    Returns
    -------
    str or None
        ``lps`` or ``ras``; None where the header names none.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix == ".vtp":
        return _stated_in_vtp(path)
    with path.open("rb") as stream:
        head = stream.read(_HEADER_BYTES)
    if suffix == ".stl":
        # A binary file has 80 bytes for text, one in plain text its first line.
        head = head.lstrip().partition(b"\n")[0] if is_text(head) else head[:80]
    elif suffix == ".vtk":
        # The second line is a title.
        head = b"\n".join(head.splitlines()[1:2])
    elif suffix == ".ply":
        lines = head.partition(b"end_header")[0].splitlines()
        head = b"\n".join(line for line in lines if line.startswith((b"comment", b"obj_info")))
    else:
        head = b"\n".join(line for line in head.splitlines() if line.startswith(b"#"))
    found = _STATED.search(head)
    return found.group(1).decode().lower() if found else None


def lps_from(points: Float64[np.ndarray, "n 3"], space: str) -> Float64[np.ndarray, "n 3"]:
    """Convert points to LPS: x points to the patient's left, y to the back, z to the head.

    From RAS the first two axes are negated. That is a rotation by 180 deg and no mirror, so a wrong choice
    looks like another pose of the same vessel.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Points in any unit.
    space : {'lps', 'ras'}
        Axes that they are in.

    Returns
    -------
    ndarray, shape (n, 3)
        Points in LPS.

    Raises
    ------
    InputError
        If ``space`` is another.
    """
    if space not in ("lps", "ras"):
        raise InputError(f"space: expected lps or ras, received {space!r}")
    return points * np.array([-1.0, -1.0, 1.0]) if space == "ras" else points


def write_model(path: Path, surface: Surface, space: str = "lps") -> None:
    """Write a surface whose header names its axes, binary in single precision.

    Parameters
    ----------
    path : Path
        File ending in ``.ply``, ``.stl`` or ``.vtp``; its folder must exist.
    surface : Surface
        Mesh in mm, or in ``.vtp`` points too: each gets a cell of its own there, without which a viewer shows none.
    space : {'lps', 'ras'}, optional
        Axes that it is in.

    Raises
    ------
    InputError
        If the suffix or the axes are others, or points are to be written as ``.ply`` or ``.stl``.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in WRITABLE:
        raise InputError(
            f"{path}: expected one of {', '.join(WRITABLE)} to write, received {path.suffix or 'none'}"
        )
    if space not in ("lps", "ras"):
        raise InputError(f"space: expected lps or ras, received {space!r}")
    if suffix != ".vtp" and not isinstance(surface, Mesh):
        raise InputError(f"{path}: expected a mesh to write as {suffix}, received points; .vtp holds them")
    writer = _writer(suffix, space)
    writer.SetInputData(_polydata(surface, space if suffix == ".vtp" else None))
    with atomic_write(path) as temporary:
        writer.SetFileName(str(temporary))
        if not writer.Write():
            raise OSError(f"{path}: could not be written")


def _writer(suffix: str, space: str) -> Any:
    """The writer of a suffix, with the name of the axes in its header; VTP has it as a field of the data."""
    from vtkmodules.vtkIOGeometry import vtkSTLWriter
    from vtkmodules.vtkIOPLY import vtkPLYWriter
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

    if suffix == ".vtp":
        return vtkXMLPolyDataWriter()
    stated = f"SPACE={space.upper()}"
    if suffix == ".ply":
        writer = vtkPLYWriter()
        writer.AddComment(stated)
    else:
        writer = vtkSTLWriter()
        writer.SetHeader(stated)
    writer.SetFileTypeToBinary()
    return writer


def _polydata(surface: Surface, space: str | None) -> Any:
    """The surface as VTK has it, with a field for its axes where they are given."""
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonCore import vtkPoints, vtkStringArray
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData

    places = vtkPoints()
    places.SetData(numpy_to_vtk(np.ascontiguousarray(points_of(surface), dtype=np.float32), deep=True))
    corners = surface.triangles if isinstance(surface, Mesh) else np.arange(len(surface))[:, None]
    cells = vtkCellArray()
    cells.SetData(
        numpy_to_vtkIdTypeArray(np.arange(0, corners.size + 1, corners.shape[1], dtype=np.int64), deep=True),
        numpy_to_vtkIdTypeArray(np.ascontiguousarray(corners.reshape(-1), dtype=np.int64), deep=True),
    )
    data = vtkPolyData()
    data.SetPoints(places)
    if isinstance(surface, Mesh):
        data.SetPolys(cells)
    else:
        data.SetVerts(cells)
    if space is not None:
        field = vtkStringArray()
        field.SetName("SPACE")
        field.InsertNextValue(space.upper())
        data.GetFieldData().AddArray(field)
    return data


def _stated_in_vtp(path: Path) -> str | None:
    field = read_polydata(path).GetFieldData().GetAbstractArray("SPACE")
    value = str(field.GetValue(0)).lower() if field is not None and field.GetNumberOfValues() else ""
    return next((space for space in ("lps", "ras") if space in value), None)
