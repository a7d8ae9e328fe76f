"""VTK's surfaces in both formats, cut short, and with cells of points that are not there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from registration.errors import InputError
from registration.io.surface_files.vtk_polydata import read_vtk_surface

POINTS = "0 0 1 4 0 1 4 3 1 0 3 1"
EXPECTED = np.array([[0.0, 0, 1], [4, 0, 1], [4, 3, 1], [0, 3, 1]])


def legacy(kind: str, cells: str) -> str:
    return f"# vtk DataFile Version 3.0\na title\nASCII\nDATASET {kind}\nPOINTS 4 float\n{POINTS}\n{cells}"


def area(path: Path) -> float:
    found = read_vtk_surface(path)
    a, b, c = np.moveaxis(found.points[found.triangles()], 1, 0)
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


@pytest.mark.parametrize(
    "text",
    [
        legacy("POLYDATA", "POLYGONS 2 8\n3 0 1 2\n3 2 3 0\n"),
        legacy("POLYDATA", "POLYGONS 1 5\n4 0 1 2 3\n"),
        legacy("POLYDATA", "LINES 1 3\n2 0 1\nTRIANGLE_STRIPS 1 5\n4 0 1 3 2\n"),
        legacy("UNSTRUCTURED_GRID", "CELLS 2 8\n3 0 1 2\n3 2 3 0\nCELL_TYPES 2\n5\n5\n"),
        legacy("UNSTRUCTURED_GRID", "CELLS 1 5\n4 0 1 2 3\nCELL_TYPES 1\n9\n"),
        legacy(
            "POLYDATA",
            "POLYGONS 1 5\n4 0 1 2 3\nPOINT_DATA 4\nSCALARS a signed_char 1\nLOOKUP_TABLE default\n1 2 3 4\n",
        ),
        legacy(
            "POLYDATA", "POLYGONS 2 4\noffsets vtktypeint64\n0 4\nconnectivity vtktypeint64\n0 1 2 3\n"
        ).replace("3.0", "5.1"),
    ],
)
def test_legacy_files(tmp_path: Path, text: str) -> None:
    (tmp_path / "m.vtk").write_text(text)
    assert area(tmp_path / "m.vtk") == pytest.approx(12)


@pytest.mark.parametrize("binary", [True, False])
def test_what_vtk_itself_writes(tmp_path: Path, binary: bool) -> None:
    from vtkmodules.vtkFiltersSources import vtkSphereSource
    from vtkmodules.vtkIOLegacy import vtkPolyDataWriter

    source, writer = vtkSphereSource(), vtkPolyDataWriter()
    writer.SetInputConnection(source.GetOutputPort())
    writer.SetFileName(str(tmp_path / "m.vtk"))
    (writer.SetFileTypeToBinary if binary else writer.SetFileTypeToASCII)()
    writer.Write()
    source.Update()
    found = read_vtk_surface(tmp_path / "m.vtk")
    assert len(found.triangles()) == source.GetOutput().GetNumberOfPolys()
    np.testing.assert_allclose(np.linalg.norm(found.points, axis=1), 0.5, atol=1e-4)
    whole = (tmp_path / "m.vtk").read_bytes()
    for share in (0.05, 0.3, 0.6, 0.9):
        (tmp_path / "cut.vtk").write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(InputError, match=r"cut\.vtk: .*expected"):
            read_vtk_surface(tmp_path / "cut.vtk")


@pytest.mark.parametrize(
    "text, message",
    [
        ("rubbish", "expected a VTK file that begins with # vtk DataFile Version, received another"),
        (
            legacy("POLYDATA", "POLYGONS 1 4\n3 0 1 9\n"),
            "triangles: expected indices from 0 to 3, received 0 to 9",
        ),
        (
            legacy("POLYDATA", "POLYGONS 1 4\n3 0 1 -2\n"),
            "triangles: expected indices from 0 to 3, received -2 to 1",
        ),
        (
            legacy("UNSTRUCTURED_GRID", "CELLS 1 4\n3 0 1 9\nCELL_TYPES 1\n5\n"),
            "triangles: expected indices from 0 to 3, received 0 to 9",
        ),
        (
            legacy("POLYDATA", "TRIANGLE_STRIPS 1 1\n0\n"),
            "expected strips of triangles, received one of no corner",
        ),
        (
            legacy("POLYDATA", "POLYGONS 1 4\n3 0 1 2\n").replace(
                "POINTS", "FIELD F 1\nnone 1 0 double\n\nPOINTS"
            ),
            "expected arrays that hold values, found 'none' without any",
        ),
        *(
            (
                legacy("UNSTRUCTURED_GRID", f"CELLS 2 9\n3 0 1 2\n4 0 1 2 3\nCELL_TYPES {types}\n"),
                f"expected {message}",
            )
            for types, message in (
                ("2\n12\n12", "cells with the corners of their type, received type 12 with 3 to 4"),
                ("2\n5\n200", "cells with the corners of their type, received type 200 with 4 to 4"),
                ("2\n22\n9", "cells with the corners of their type, received type 22 with 3 to 3"),
                ("1\n5", "a type for each of 2 cells, received 1"),
            )
        ),
        *(
            (
                legacy("POLYDATA", f"POLYGONS 3 6\nOFFSETS vtktypeint64\n{ends}\n").replace(
                    "Version 3.0", "Version 5.1"
                )
                + "CONNECTIVITY vtktypeint64\n0 1 2 2 3 0\n",
                "expected cells that end within 6 numbers, received others: cut short or damaged",
            )
            for ends in ("0 3 9", "0 6 3", "-1 3 6", "7 7 7")
        ),
        (
            "# vtk DataFile Version 3.0\nt\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 2 2 2\n",
            r"expected a surface \(POLYDATA or UNSTRUCTURED_GRID\), received STRUCTURED_POINTS",
        ),
    ],
)
def test_what_is_no_surface_is_refused(tmp_path: Path, capfd, text: str, message: str) -> None:
    (tmp_path / "m.vtk").write_text(text)
    with pytest.raises(InputError, match=rf"m\.vtk: {message}"):
        read_vtk_surface(tmp_path / "m.vtk")
    assert capfd.readouterr() == ("", "")


def test_an_xml_file_with_a_wrong_index_is_refused(tmp_path: Path) -> None:
    array = '<DataArray type="Int64" Name="{}" format="ascii">{}</DataArray>'
    (tmp_path / "m.vtp").write_text(
        '<?xml version="1.0"?><VTKFile type="PolyData" version="1.0" byte_order="LittleEndian"><PolyData>'
        '<Piece NumberOfPoints="4" NumberOfPolys="1"><Points><DataArray type="Float64" NumberOfComponents="3" '
        f'format="ascii">{POINTS}</DataArray></Points><Polys>{array.format("connectivity", "0 1 9")}'
        f"{array.format('offsets', '3')}</Polys></Piece></PolyData></VTKFile>"
    )
    with pytest.raises(InputError, match=r"m\.vtp: triangles: expected indices from 0 to 3, received 0 to 9"):
        read_vtk_surface(tmp_path / "m.vtp")


@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize("version", [42, 51])
@pytest.mark.parametrize("grid", [True, False])
def test_attributes_fields_and_what_is_known_of_them_are_passed_over(
    tmp_path: Path, binary: bool, version: int, grid: bool
) -> None:
    """Both versions of the format, with arrays of all sorts before and after the polygons."""
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkFiltersCore import vtkAppendFilter
    from vtkmodules.vtkFiltersSources import vtkSphereSource
    from vtkmodules.vtkIOLegacy import vtkPolyDataWriter, vtkUnstructuredGridWriter

    source = vtkSphereSource()
    source.Update()
    data = source.GetOutput()
    if grid:
        append = vtkAppendFilter()
        append.SetInputData(data)
        append.Update()
        data = append.GetOutput()
    for name, width, number in (("a", 1, np.float64), ("b", 4, np.uint8), ("c", 9, np.float32)):
        values = numpy_to_vtk(np.ones((data.GetNumberOfPoints(), width), dtype=number), deep=True)
        values.SetName(name)
        values.SetComponentName(0, "first")
        data.GetPointData().AddArray(values)
    data.GetPointData().SetActiveScalars("a")
    field = numpy_to_vtk(np.arange(3.0), deep=True)
    field.SetName("of the file")
    data.GetFieldData().AddArray(field)
    writer = vtkUnstructuredGridWriter() if grid else vtkPolyDataWriter()
    writer.SetInputData(data)
    writer.SetFileVersion(version)
    writer.SetFileName(str(tmp_path / "m.vtk"))
    (writer.SetFileTypeToBinary if binary else writer.SetFileTypeToASCII)()
    writer.Write()
    assert len(read_vtk_surface(tmp_path / "m.vtk").triangles()) == data.GetNumberOfCells()
    whole = (tmp_path / "m.vtk").read_bytes()
    refused = 0
    for share in np.linspace(0.05, 0.95, 19):
        (tmp_path / "cut.vtk").write_bytes(whole[: int(share * len(whole))])
        try:
            found = read_vtk_surface(tmp_path / "cut.vtk")
        except InputError as refusal:
            assert "cut.vtk: " in str(refusal)
            refused += 1
        else:
            # Cut between two sections of attributes, which leaves the surface whole.
            assert len(found.triangles()) == data.GetNumberOfCells()
    assert refused >= 17
