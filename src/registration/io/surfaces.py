"""Clouds, meshes and centerlines from and to files, in millimetres as the file has them.

A file with triangles is read as a ``Mesh``, one without as points (n, 3). Every refusal is one sentence that names the
file. Files are written atomically, so that nothing half-written is left under it.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path

import numpy as np

from registration.errors import InputError
from registration.geometry.open3d_bridge import point_body, quiet_open3d, triangle_body
from registration.geometry.shapes import Centerline, Mesh, Polyline, Surface, require_cloud
from registration.input_files import guarded
from registration.io.atomic import atomic_write
from registration.io.surface_files.obj import read_obj
from registration.io.surface_files.pcd import read_pcd
from registration.io.surface_files.ply import read_ply
from registration.io.surface_files.polygons import Polygons
from registration.io.surface_files.stl import read_stl
from registration.io.surface_files.text_clouds import read_text_cloud
from registration.io.surface_files.vtk_polydata import SUFFIXES as VTK_SUFFIXES
from registration.io.surface_files.vtk_polydata import read_polydata, read_vtk_surface
from registration.io.truncation import require_file

WRITABLE = (".ply", ".xyz")
_READERS: dict[str, Callable[[Path], Polygons]] = {
    ".ply": read_ply,
    ".pcd": read_pcd,
    ".stl": read_stl,
    ".obj": read_obj,
    ".vtp": read_vtk_surface,
    ".vtk": read_vtk_surface,
    ".xyz": read_text_cloud,
    ".txt": read_text_cloud,
}
READABLE = tuple(_READERS)


@guarded("a mesh or a cloud")
def read_surface(path: Path) -> Surface:
    """Read a mesh or a cloud.

    Polygons are cut into triangles; equal corners of an STL file become one vertex; vertices of no triangle
    are left out.

    Parameters
    ----------
    path : Path
        PLY, STL, OBJ, VTP or VTK file; a cloud where it has no faces, or PCD, XYZ or TXT.

    Returns
    -------
    Surface
        Mesh or points, in the file's unit.

    Raises
    ------
    InputError
        If the file is missing, of an unknown kind, unreadable, cut short or empty, or has NaN, no area, or
        all points on a point or a line.
    """
    path = require_file(path)
    suffix = path.suffix.lower()
    if suffix not in _READERS:
        raise InputError(
            f"{path}: expected a mesh or a cloud ({', '.join(READABLE)}), received {suffix or 'no suffix'}"
        )
    found = _READERS[suffix](path)
    if not len(found.points):
        raise InputError(f"{path}: expected a readable {suffix[1:].upper()} file with points, received none")
    try:
        triangles = found.triangles()
        points_mm, triangles = _used(found.points, triangles) if len(triangles) else (found.points, triangles)
    except InputError as refusal:
        raise InputError(f"{path}: {refusal}") from refusal
    if not len(triangles) or not np.isfinite(points_mm).all():
        return require_cloud(points_mm, str(path))
    mesh = Mesh(points_mm, triangles)
    if not mesh.areas_mm2.sum() > 0:
        raise InputError(f"{path}: expected triangles with area, received only degenerate ones")
    require_cloud(points_mm, str(path))
    return mesh


def write_surface(path: Path, surface: Surface) -> None:
    """Write a mesh or a cloud, replacing what is there.

    Parameters
    ----------
    path : Path
        File ending in ``.ply``, or ``.xyz`` for a cloud; its folder must exist.
    surface : Surface
        Mesh or points.

    Raises
    ------
    InputError
        If the suffix is another, or a mesh is to be written as XYZ.
    OSError
        If the file could not be written.
    """
    path = Path(path)
    if path.suffix.lower() not in WRITABLE:
        raise InputError(f"{path}: expected one of {', '.join(WRITABLE)} to write, received {path.suffix}")
    if path.suffix.lower() == ".xyz":
        if isinstance(surface, Mesh):
            raise InputError(f"{path}: expected a cloud to write as XYZ, received a mesh")
        with atomic_write(path) as temporary:
            np.savetxt(temporary, surface, fmt="%.10g")
        return
    with atomic_write(path) as temporary, quiet_open3d() as open3d:
        if isinstance(surface, Mesh):
            written = open3d.io.write_triangle_mesh(str(temporary), triangle_body(surface))
        else:
            written = open3d.io.write_point_cloud(str(temporary), point_body(surface))
        if not written:
            raise OSError(f"{path}: could not be written")


@guarded("a centerline of VTK")
def read_centerline(path: Path) -> Centerline:
    """Read the polylines of a VTK file.

    Parameters
    ----------
    path : Path
        VTP or VTK file with the point array MaximumInscribedSphereRadius (VMTK's), Radius or radius_mm.

    Returns
    -------
    Centerline
        Lines in the file's unit.

    Raises
    ------
    InputError
        If the file is missing or of another kind, or has no lines or no radius.
    """
    path = require_file(path)
    if path.suffix.lower() not in VTK_SUFFIXES:
        raise InputError(f"{path}: expected a centerline as .vtp, received {path.suffix or 'no suffix'}")
    from vtkmodules.util.numpy_support import vtk_to_numpy

    data = read_polydata(path)
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


def _used(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The vertices that a triangle has, and the triangles over them; others would count in the mesh's extent."""
    used = np.unique(triangles)
    if len(used) == len(points):
        return points, triangles
    return points[used], np.searchsorted(used, triangles)
