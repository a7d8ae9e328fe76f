"""Whether a file says which axes it is in, read back by this program and by VTK as 3D Slicer does."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from vessels import bent_tube

from registration.errors import InputError
from registration.geometry.shapes import Mesh
from registration.io.patient_space import lps_from, stated_space, write_model
from registration.io.surfaces import read_surface, write_surface

TUBE = bent_tube()


@pytest.mark.parametrize("space", ["lps", "ras"])
@pytest.mark.parametrize("name", ["m.ply", "m.stl", "M.STL", "m.vtp"])
def test_a_written_model_reads_back_and_states_its_space(tmp_path: Path, name: str, space: str) -> None:
    write_model(tmp_path / name, TUBE, space)
    found = read_surface(tmp_path / name)
    assert isinstance(found, Mesh)
    np.testing.assert_allclose(found.corners_mm, TUBE.corners_mm, atol=2e-5)
    assert len(found.vertices_mm) == len(TUBE.vertices_mm)
    assert stated_space(tmp_path / name) == space
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_vtk_finds_the_space_where_slicer_looks_for_it(tmp_path: Path) -> None:
    from vtkmodules.vtkIOGeometry import vtkSTLReader
    from vtkmodules.vtkIOPLY import vtkPLYReader

    write_model(tmp_path / "m.stl", TUBE)
    write_model(tmp_path / "m.ply", TUBE)
    stl, ply = vtkSTLReader(), vtkPLYReader()
    stl.SetFileName(str(tmp_path / "m.stl"))
    ply.SetFileName(str(tmp_path / "m.ply"))
    stl.Update()
    ply.Update()
    assert "SPACE=LPS" in stl.GetHeader()
    comments = ply.GetComments()
    assert "SPACE=LPS" in [comments.GetValue(at) for at in range(comments.GetNumberOfValues())]
    assert ply.GetOutput().GetNumberOfPolys() == len(TUBE.triangles)


@pytest.mark.parametrize(
    "name, content, space",
    [
        ("a.stl", b"solid 3D Slicer output. SPACE=RAS\nfacet normal 0 0 1\n", "ras"),
        ("a.stl", b"solid vessel\nfacet SPACE=RAS\n", None),
        ("a.stl", b"3D Slicer output. SPACE=LPS".ljust(80) + b"SPACE=RAS", "lps"),
        ("a.stl", b"exported".ljust(80) + b"SPACE=RAS", None),
        ("a.stl", b" SOLID 3D Slicer output. SPACE=RAS\nFACET\n", "ras"),
        ("a.stl", b"solid vessel ".ljust(90) + b"SPACE=LPS\nfacet\n", "lps"),
        ("a.stl", b"solid vessel".ljust(80) + b"\0SPACE=RAS", None),
        ("a.vtk", b"# vtk DataFile Version 5.1\n3D Slicer output. SPACE=RAS\nASCII\n", "ras"),
        ("a.vtk", b"# vtk DataFile Version 5.1\nvessel\nASCII\nSPACE=RAS", None),
        ("a.ply", b"ply\nformat ascii 1.0\ncomment SPACE=RAS\nend_header\n", "ras"),
        ("a.ply", b"ply\nformat ascii 1.0\nend_header\ncomment SPACE=RAS\n", None),
        ("a.obj", b"# 3D Slicer output. SPACE=LPS\nv 0 0 0\n", "lps"),
        ("a.obj", b"g SPACE=LPS\nv 0 0 0\n", None),
    ],
)
def test_headers_as_other_programs_write_them(
    tmp_path: Path, name: str, content: bytes, space: str | None
) -> None:
    (tmp_path / name).write_bytes(content)
    assert stated_space(tmp_path / name) == space


@pytest.mark.parametrize("space, written", [("ras", "RAS"), ("lps", "LPS"), (None, "world"), (None, None)])
def test_the_field_of_a_vtp_file(tmp_path: Path, space: str | None, written: str | None) -> None:
    from vtkmodules.vtkCommonCore import vtkStringArray
    from vtkmodules.vtkCommonDataModel import vtkPolyData
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

    data = vtkPolyData()
    if written is not None:
        field = vtkStringArray()
        field.SetName("SPACE")
        field.InsertNextValue(written)
        data.GetFieldData().AddArray(field)
    writer = vtkXMLPolyDataWriter()
    writer.SetFileName(str(tmp_path / "a.vtp"))
    writer.SetInputData(data)
    writer.Write()
    assert stated_space(tmp_path / "a.vtp") == space


def test_a_file_of_this_program_without_a_patient_states_none(tmp_path: Path) -> None:
    write_surface(tmp_path / "m.ply", TUBE)
    assert stated_space(tmp_path / "m.ply") is None


def test_points_have_a_cell_each_in_vtp(tmp_path: Path) -> None:
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

    write_model(tmp_path / "cloud.vtp", TUBE.vertices_mm, "ras")
    reader = vtkXMLPolyDataReader()
    reader.SetFileName(str(tmp_path / "cloud.vtp"))
    reader.Update()
    found = reader.GetOutput()
    assert (found.GetNumberOfVerts(), found.GetNumberOfPolys()) == (len(TUBE.vertices_mm), 0)
    assert stated_space(tmp_path / "cloud.vtp") == "ras"
    np.testing.assert_allclose(read_surface(tmp_path / "cloud.vtp"), TUBE.vertices_mm, atol=1e-5)


def test_ras_turns_the_first_two_axes_over() -> None:
    points = np.array([[1.0, 2.0, 3.0]])
    np.testing.assert_array_equal(lps_from(points, "ras"), [[-1, -2, 3]])
    np.testing.assert_array_equal(lps_from(points, "lps"), points)
    with pytest.raises(InputError, match="space: expected lps or ras, received 'scanner'"):
        lps_from(points, "scanner")


def test_writing_refuses_what_it_can_not_hold(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"m\.obj: expected one of \.ply, \.stl, \.vtp to write"):
        write_model(tmp_path / "m.obj", TUBE)
    with pytest.raises(InputError, match="space: expected lps or ras, received 'LPS'"):
        write_model(tmp_path / "m.ply", TUBE, "LPS")
    with pytest.raises(
        InputError, match=r"m\.ply: expected a mesh to write as \.ply, received points; \.vtp holds"
    ):
        write_model(tmp_path / "m.ply", TUBE.vertices_mm)
    assert not list(tmp_path.iterdir())
