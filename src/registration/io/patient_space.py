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
from registration.geometry.shapes import Mesh
from registration.input_files import guarded
from registration.io.atomic import atomic_write
from registration.io.surface_files.stl import is_text
from registration.io.surface_files.vtk_polydata import read_polydata

WRITABLE = (".ply", ".stl")
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


def write_model(path: Path, mesh: Mesh, space: str = "lps") -> None:
    """Write a surface whose header names its axes, binary in single precision.

    Parameters
    ----------
    path : Path
        File ending in ``.ply`` or ``.stl``; its folder must exist.
    mesh : Mesh
        Surface in mm.
    space : {'lps', 'ras'}, optional
        Axes that it is in.

    Raises
    ------
    InputError
        If the suffix or the axes are others.
    """
    path = Path(path)
    if path.suffix.lower() not in WRITABLE:
        raise InputError(
            f"{path}: expected one of {', '.join(WRITABLE)} to write, received {path.suffix or 'none'}"
        )
    if space not in ("lps", "ras"):
        raise InputError(f"space: expected lps or ras, received {space!r}")
    from vtkmodules.vtkIOGeometry import vtkSTLWriter
    from vtkmodules.vtkIOPLY import vtkPLYWriter

    stated = f"SPACE={space.upper()}"
    if path.suffix.lower() == ".ply":
        writer = vtkPLYWriter()
        writer.AddComment(stated)
    else:
        writer = vtkSTLWriter()
        writer.SetHeader(stated)
    writer.SetFileTypeToBinary()
    writer.SetInputData(_polydata(mesh))
    with atomic_write(path) as temporary:
        writer.SetFileName(str(temporary))
        if not writer.Write():
            raise OSError(f"{path}: could not be written")


def _polydata(mesh: Mesh) -> Any:
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData

    places = vtkPoints()
    places.SetData(numpy_to_vtk(np.ascontiguousarray(mesh.vertices_mm, dtype=np.float32), deep=True))
    faces = vtkCellArray()
    faces.SetData(
        numpy_to_vtkIdTypeArray(np.arange(0, mesh.triangles.size + 1, 3, dtype=np.int64), deep=True),
        numpy_to_vtkIdTypeArray(np.ascontiguousarray(mesh.triangles.reshape(-1), dtype=np.int64), deep=True),
    )
    data = vtkPolyData()
    data.SetPoints(places)
    data.SetPolys(faces)
    return data


def _stated_in_vtp(path: Path) -> str | None:
    field = read_polydata(path).GetFieldData().GetAbstractArray("SPACE")
    value = str(field.GetValue(0)).lower() if field is not None and field.GetNumberOfValues() else ""
    return next((space for space in ("lps", "ras") if space in value), None)
