"""Clouds, meshes and centerlines from and to files, in millimetres as the file has them.

A file with triangles is read as a ``Mesh``, one without as points (n, 3). Every refusal is one sentence that names the
file. Files are written beside their final name and renamed, so that nothing half-written is left under it.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from registration.errors import InputError
from registration.file_checks import require_complete, require_file
from registration.geometry import Centerline, Mesh, Polyline, require_cloud
from registration.metrics import Surface
from registration.whole import written_beside

READABLE = (".ply", ".pcd", ".stl", ".obj", ".vtp", ".xyz", ".txt")
WRITABLE = (".ply", ".xyz")


def read_surface(path: Path) -> Surface:
    """Read a mesh (PLY, STL, OBJ, VTP with faces) or a cloud (those without, PCD, XYZ or TXT with x y z first).

    Polygons are cut into triangles; equal corners of an STL file become one vertex. Raises InputError for a file that
    is missing, of an unknown kind, unreadable or cut short, empty, with NaN, or with all points on a point or a line.
    """
    path = require_file(path)
    suffix = path.suffix.lower()
    if suffix not in READABLE:
        raise InputError(f"{path}: expected one of {', '.join(READABLE)}, received {suffix or 'no suffix'}")
    require_complete(path)
    read: Callable[[Path], tuple[np.ndarray, np.ndarray]] = {
        ".pcd": _read_pcd,
        ".vtp": _read_vtp,
        ".xyz": _read_text,
        ".txt": _read_text,
    }.get(suffix, _read_open3d)
    points_mm, triangles = read(path)
    if not len(points_mm):
        raise InputError(f"{path}: expected a readable {suffix[1:].upper()} file with points, received none")
    require_cloud(points_mm, str(path))
    if not len(triangles):
        return points_mm
    if suffix == ".stl":
        points_mm, owner = np.unique(points_mm, axis=0, return_inverse=True)
        triangles = owner.reshape(-1)[triangles]
    try:
        mesh = Mesh(points_mm, triangles)
    except InputError as refusal:
        raise InputError(f"{path}: {refusal}") from refusal
    if not mesh.areas_mm2.sum() > 0:
        raise InputError(f"{path}: expected triangles with area, received only degenerate ones")
    return mesh


def write_surface(path: Path, surface: Surface) -> None:
    """Write a mesh (PLY) or a cloud (PLY, XYZ), replacing what is there; its folder must exist."""
    path = Path(path)
    if path.suffix.lower() not in WRITABLE:
        raise InputError(f"{path}: expected one of {', '.join(WRITABLE)} to write, received {path.suffix}")
    if path.suffix.lower() == ".xyz":
        if isinstance(surface, Mesh):
            raise InputError(f"{path}: expected a cloud to write as XYZ, received a mesh")
        with written_beside(path) as temporary:
            np.savetxt(temporary, surface, fmt="%.10g")
        return
    open3d = _open3d()
    if isinstance(surface, Mesh):
        body = open3d.geometry.TriangleMesh(
            open3d.utility.Vector3dVector(surface.vertices_mm),
            open3d.utility.Vector3iVector(surface.triangles.astype(np.int32)),
        )
        write = open3d.io.write_triangle_mesh
    else:
        body = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(surface))
        write = open3d.io.write_point_cloud
    with written_beside(path) as temporary, _quiet_open3d():
        if not write(str(temporary), body):
            raise OSError(f"{path}: could not be written")


def read_centerline(path: Path) -> Centerline:
    """Read the polylines of a VTP file with the point array MaximumInscribedSphereRadius (as VMTK writes) or Radius."""
    path = require_file(path)
    if path.suffix.lower() != ".vtp":
        raise InputError(f"{path}: expected a centerline as .vtp, received {path.suffix or 'no suffix'}")
    from vtkmodules.util.numpy_support import vtk_to_numpy

    data = _polydata(path)
    radius = next(
        (
            array
            for name in ("MaximumInscribedSphereRadius", "Radius", "radius_mm")
            if (array := data.GetPointData().GetArray(name)) is not None
        ),
        None,
    )
    if radius is None or not data.GetNumberOfLines():
        found = f"{data.GetNumberOfLines()} lines and {'a' if radius is not None else 'no'} radius"
        raise InputError(f"{path}: expected polylines with MaximumInscribedSphereRadius, received {found}")
    points_mm = vtk_to_numpy(data.GetPoints().GetData()).astype(np.float64)
    radius_mm = vtk_to_numpy(radius).astype(np.float64)
    lines = data.GetLines()
    offsets = vtk_to_numpy(lines.GetOffsetsArray())
    index = vtk_to_numpy(lines.GetConnectivityArray())
    try:
        return Centerline(
            tuple(
                Polyline(points_mm[index[begin:end]], radius_mm[index[begin:end]])
                for begin, end in itertools.pairwise(offsets)
            )
        )
    except InputError as refusal:
        raise InputError(f"{path}: {refusal}") from refusal


def _read_open3d(path: Path) -> tuple[np.ndarray, np.ndarray]:
    open3d = _open3d()
    with _quiet_open3d():
        mesh = open3d.io.read_triangle_mesh(str(path))
    return np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.triangles, dtype=np.int64)


def _read_pcd(path: Path) -> tuple[np.ndarray, np.ndarray]:
    open3d = _open3d()
    with _quiet_open3d():
        cloud = open3d.io.read_point_cloud(str(path), remove_nan_points=False, remove_infinite_points=False)
    return np.asarray(cloud.points, dtype=np.float64), np.empty((0, 3), dtype=np.int64)


def _read_text(path: Path) -> tuple[np.ndarray, np.ndarray]:
    try:
        text = path.read_text(encoding="utf-8").replace(",", " ").replace(";", " ")
        rows = [
            line.split() for line in text.splitlines() if line.strip() and not line.strip().startswith("#")
        ]
        short = next((row for row in rows if len(row) < 3), None)
        if short is not None:
            raise ValueError(f"the row {' '.join(short)!r}")
        points_mm = np.array([[float(entry) for entry in row[:3]] for row in rows], dtype=np.float64)
    except ValueError as refusal:
        raise InputError(f"{path}: expected rows of x y z, received {refusal}") from refusal
    return points_mm.reshape(-1, 3), np.empty((0, 3), dtype=np.int64)


def _read_vtp(path: Path) -> tuple[np.ndarray, np.ndarray]:
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkFiltersCore import vtkTriangleFilter

    cutter = vtkTriangleFilter()
    cutter.SetInputData(_polydata(path))
    cutter.PassLinesOff()
    cutter.PassVertsOff()
    cutter.Update()
    data = cutter.GetOutput()
    if not data.GetNumberOfPoints():
        return np.empty((0, 3)), np.empty((0, 3), dtype=np.int64)
    triangles = vtk_to_numpy(data.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    return vtk_to_numpy(data.GetPoints().GetData()).astype(np.float64), triangles.astype(np.int64)


def _polydata(path: Path) -> Any:
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

    errors: list[str] = []
    reader = vtkXMLPolyDataReader()
    reader.SetFileName(str(path))
    # An observer also keeps VTK's own report off the terminal.
    for source in (reader, reader.GetReaderErrorObserver()):
        if source is not None:
            source.AddObserver("ErrorEvent", lambda *_: errors.append("error"))
    reader.Update()
    if errors or reader.GetErrorCode():
        raise InputError(f"{path}: expected a complete VTP file, received one that cannot be read")
    return reader.GetOutput()


def _open3d() -> Any:
    """Open3D, imported only where a file needs it: it takes a second, and its type stubs are not right."""
    import open3d

    return open3d


@contextmanager
def _quiet_open3d() -> Iterator[None]:
    open3d = _open3d()
    with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
        yield
