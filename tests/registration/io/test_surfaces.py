"""Every format read back, every broken file refused by name, nothing half-written under a final name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import open3d
import pytest
from vessels import bent_tube

from registration.errors import InputError
from registration.geometry.shapes import Mesh
from registration.io.atomic import atomic_write
from registration.io.surfaces import read_centerline, read_surface, write_surface

TUBE = bent_tube(along=20, around=8)


def as_open3d(mesh: Mesh) -> open3d.geometry.TriangleMesh:
    body = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(mesh.vertices_mm), open3d.utility.Vector3iVector(mesh.triangles)
    )
    body.compute_triangle_normals()
    return body


def write_vtp(
    path: Path, points: np.ndarray, cells: dict[str, list[list[int]]], radius: np.ndarray | None = None
) -> None:
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

    data, held = vtkPolyData(), vtkPoints()
    held.SetData(numpy_to_vtk(points, deep=True))
    data.SetPoints(held)
    for kind, members in cells.items():
        array = vtkCellArray()
        for member in members:
            array.InsertNextCell(len(member))
            for index in member:
                array.InsertCellPoint(index)
        getattr(data, f"Set{kind}")(array)
    if radius is not None:
        values = numpy_to_vtk(radius, deep=True)
        values.SetName("MaximumInscribedSphereRadius")
        data.GetPointData().AddArray(values)
    writer = vtkXMLPolyDataWriter()
    writer.SetFileName(str(path))
    writer.SetInputData(data)
    writer.Write()


def same_surface(found: object, expected: Mesh, tolerance_mm: float) -> None:
    assert isinstance(found, Mesh)
    assert len(found.triangles) == len(expected.triangles)
    np.testing.assert_allclose(found.corners_mm, expected.corners_mm, atol=tolerance_mm)


@pytest.mark.parametrize("ascii_text", [True, False])
def test_ply_mesh(tmp_path: Path, ascii_text: bool) -> None:
    open3d.io.write_triangle_mesh(str(tmp_path / "m.ply"), as_open3d(TUBE), write_ascii=ascii_text)
    # As text Open3D writes six digits.
    same_surface(read_surface(tmp_path / "m.ply"), TUBE, 1e-3 if ascii_text else 0.0)


def test_stl_corners_become_shared_vertices(tmp_path: Path) -> None:
    open3d.io.write_triangle_mesh(str(tmp_path / "m.STL"), as_open3d(TUBE))
    found = read_surface(tmp_path / "m.STL")
    same_surface(found, TUBE, 1e-4)
    assert isinstance(found, Mesh)
    assert len(found.vertices_mm) == len(TUBE.vertices_mm)


def test_stl_as_text(tmp_path: Path) -> None:
    (tmp_path / "t.stl").write_text(
        "solid t\nfacet normal 0 0 1\nouter loop\nvertex 0 0 5\nvertex 3 0 5\nvertex 0 4 5\n"
        "endloop\nendfacet\nendsolid t\n"
    )
    found = read_surface(tmp_path / "t.stl")
    assert isinstance(found, Mesh)
    np.testing.assert_allclose(found.areas_mm2, [6])


def test_obj_mesh(tmp_path: Path) -> None:
    open3d.io.write_triangle_mesh(str(tmp_path / "m.obj"), as_open3d(TUBE))
    same_surface(read_surface(tmp_path / "m.obj"), TUBE, 1e-3)


def test_vtp_polygons_are_cut_into_triangles(tmp_path: Path) -> None:
    corners = np.array([[0.0, 0, 1], [4, 0, 1], [4, 3, 1], [0, 3, 1]])
    write_vtp(tmp_path / "q.vtp", corners, {"Polys": [[0, 1, 2, 3]]})
    found = read_surface(tmp_path / "q.vtp")
    assert isinstance(found, Mesh)
    assert len(found.triangles) == 2
    assert found.areas_mm2.sum() == pytest.approx(12)


def test_vtp_without_faces_is_a_cloud(tmp_path: Path) -> None:
    write_vtp(tmp_path / "c.vtp", TUBE.vertices_mm, {})
    np.testing.assert_allclose(read_surface(tmp_path / "c.vtp"), TUBE.vertices_mm)


@pytest.mark.parametrize("settings", [{"write_ascii": True}, {}, {"compressed": True}])
@pytest.mark.parametrize("suffix", ["pcd", "ply"])
def test_clouds(tmp_path: Path, suffix: str, settings: dict[str, bool]) -> None:
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(TUBE.vertices_mm))
    open3d.io.write_point_cloud(str(tmp_path / f"c.{suffix}"), cloud, **settings)
    np.testing.assert_allclose(read_surface(tmp_path / f"c.{suffix}"), TUBE.vertices_mm, atol=1e-3)


@pytest.mark.parametrize(
    "text",
    [
        "1 2 3\n4 5 6\n7 8 10\n",
        "# x y z\n1,2,3\n4, 5, 6\n\n7;8;10",
        "1 2 3 0 0 1\n4 5 6 0 0 1\n7 8 10 0 0 1\n",
    ],
)
def test_rows_of_text(tmp_path: Path, text: str) -> None:
    (tmp_path / "c.xyz").write_text(text)
    np.testing.assert_array_equal(read_surface(tmp_path / "c.xyz"), [[1, 2, 3], [4, 5, 6], [7, 8, 10]])


def test_written_surfaces_read_back(tmp_path: Path) -> None:
    write_surface(tmp_path / "m.ply", TUBE)
    back = read_surface(tmp_path / "m.ply")
    assert isinstance(back, Mesh)
    np.testing.assert_array_equal(back.vertices_mm, TUBE.vertices_mm)
    np.testing.assert_array_equal(back.triangles, TUBE.triangles)
    for name in ("c.ply", "c.xyz"):
        write_surface(tmp_path / name, TUBE.vertices_mm)
        np.testing.assert_allclose(read_surface(tmp_path / name), TUBE.vertices_mm, atol=1e-7)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["c.ply", "c.xyz", "m.ply"]


def test_writing_refuses_what_the_format_does_not_hold(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"m\.stl: expected one of \.ply, \.xyz"):
        write_surface(tmp_path / "m.stl", TUBE)
    with pytest.raises(InputError, match=r"m\.xyz: expected a cloud"):
        write_surface(tmp_path / "m.xyz", TUBE)


def test_a_failure_while_writing_leaves_the_old_file(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("old")
    with pytest.raises(RuntimeError), atomic_write(tmp_path / "a.txt") as temporary:
        temporary.write_text("half")
        raise RuntimeError
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "old"


@pytest.mark.parametrize("name", ["m.ply", "a.ply", "m.stl", "c.pcd", "b.pcd", "c.ply", "m.vtp"])
@pytest.mark.parametrize("share", [0.2, 0.6, 0.97])
def test_files_that_were_cut_short_are_refused(tmp_path: Path, name: str, share: float, capfd) -> None:
    path = tmp_path / name
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(TUBE.vertices_mm))
    if name == "m.vtp":
        write_vtp(path, TUBE.vertices_mm, {"Polys": TUBE.triangles.tolist()})
    elif name.startswith(("c", "b")):
        open3d.io.write_point_cloud(str(path), cloud, write_ascii=name.startswith("c"))
    else:
        open3d.io.write_triangle_mesh(str(path), as_open3d(TUBE), write_ascii=name.startswith("a"))
    whole = path.read_bytes()
    read_surface(path)
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(InputError, match=name) as refusal:
        read_surface(path)
    assert "\n" not in str(refusal.value)
    assert capfd.readouterr().out == ""


def test_an_obj_cut_within_a_line_is_refused(tmp_path: Path) -> None:
    (tmp_path / "m.obj").write_text("v 0 0 0\nv 3 0 0\nv 0 4 0\nf 1 2")
    with pytest.raises(InputError, match=r"m\.obj: .*cut short"):
        read_surface(tmp_path / "m.obj")


@pytest.mark.parametrize(
    "name, content, message",
    [
        ("a.xyz", "", "points, received none"),
        ("a.xyz", "1 2\n3 4\n5 6\n", "expected rows of x y z, received the row '1 2'"),
        ("a.xyz", "1 2 3\n4 5 six\n7 8 9\n", "expected rows of x y z"),
        ("a.xyz", "1 2 3\n4 nan 6\n7 8 9\n", "expected finite coordinates, received 1 points"),
        ("a.xyz", "1 2 3\n1 2 3\n1 2 3\n", "received 3 equal points"),
        ("a.xyz", "1 2 3\n2 4 6\n3 6 9\n", "received points on one line"),
        ("a.ply", "rubbish", "expected a header that ends in end_header"),
        (
            "a.ply",
            "ply\nformat ascii 1.0\nelement vertex many\nend_header\n",
            "expected a header that can be read",
        ),
        ("a.stl", "rubbish", "expected an STL file"),
        ("a.pcd", "rubbish", "expected a header that ends in DATA"),
        ("a.obj", "rubbish\n", "expected a readable OBJ file with points, received none"),
        ("a.vtp", "rubbish", "expected a complete VTP file"),
        ("a.doc", "rubbish", r"expected a mesh or a cloud \(\.ply, .*\), received \.doc"),
        ("a", "rubbish", "received no suffix"),
    ],
)
def test_files_that_are_no_surface_are_refused(tmp_path: Path, name: str, content: str, message: str) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=rf"/{name}: .*{message}"):
        read_surface(tmp_path / name)


def test_a_face_with_a_wrong_index_names_the_file(tmp_path: Path) -> None:
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    rows = (
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n"
    )
    (tmp_path / "w.ply").write_text(head + rows)
    with pytest.raises(InputError, match=r"w\.ply: triangles: expected indices from 0 to 2"):
        read_surface(tmp_path / "w.ply")


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".vtp", ".vtk"])
def test_vertices_of_no_triangle_have_no_part_in_the_extent(tmp_path: Path, suffix: str) -> None:
    points = np.array([[900.0, 0, 0], [0, 0, 5], [3, 0, 5], [np.nan, 1, 2], [0, 4, 5]])
    triangle = [1, 2, 4]
    path = tmp_path / f"m{suffix}"
    rows = "\n".join(" ".join(map(str, point)) for point in points)
    if suffix == ".ply":
        head = (
            "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n"
        )
        faces = "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
        path.write_text(f"{head}{faces}{rows}\n3 1 2 4\n")
    elif suffix == ".obj":
        path.write_text("".join(f"v {row}\n" for row in rows.splitlines()) + "f 2 3 5\n")
    elif suffix == ".vtp":
        write_vtp(path, np.nan_to_num(points), {"Polys": [triangle]})
    else:
        head = "# vtk DataFile Version 3.0\nt\nASCII\nDATASET POLYDATA\nPOINTS 5 float\n"
        path.write_text(f"{head}{rows}\nPOLYGONS 1 4\n3 1 2 4\n")
    found = read_surface(path)
    assert isinstance(found, Mesh)
    np.testing.assert_array_equal(found.vertices_mm, points[triangle])
    assert found.triangles.tolist() == [[0, 1, 2]]


def test_polygons_of_a_ply_are_cut_into_triangles(tmp_path: Path) -> None:
    head = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    faces = "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    (tmp_path / "q.ply").write_text(f"{head}{faces}0 0 1\n4 0 1\n4 3 1\n0 3 1\n4 0 1 2 3\n")
    found = read_surface(tmp_path / "q.ply")
    assert isinstance(found, Mesh)
    assert found.areas_mm2.sum() == pytest.approx(12)


def test_a_centerline_in_the_older_format_of_vtk(tmp_path: Path) -> None:
    text = "# vtk DataFile Version 3.0\nt\nASCII\nDATASET POLYDATA\nPOINTS 2 float\n0 0 0 3 4 0\nLINES 1 3\n2 0 1\n"
    text += "POINT_DATA 2\nSCALARS Radius float 1\nLOOKUP_TABLE default\n2 1.5\n"
    (tmp_path / "c.vtk").write_text(text)
    (line,) = read_centerline(tmp_path / "c.vtk").lines
    assert line.length_mm == 5
    np.testing.assert_allclose(line.radius_mm, [2, 1.5])


def test_faces_without_area_are_refused(tmp_path: Path) -> None:
    flat = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
    write_surface(tmp_path / "f.ply", flat)
    with pytest.raises(InputError, match=r"f\.ply: expected triangles with area"):
        read_surface(tmp_path / "f.ply")


def test_missing_files_folders_and_unreadable_ones_are_refused(tmp_path: Path, monkeypatch) -> None:
    with pytest.raises(InputError, match=r"none\.ply: expected a file, received nothing there"):
        read_surface(tmp_path / "none.ply")
    with pytest.raises(InputError, match="expected a file, received a folder"):
        read_surface(tmp_path)
    (tmp_path / "locked.ply").write_text("ply")

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(InputError, match=r"locked\.ply: .*received Permission denied"):
        read_surface(tmp_path / "locked.ply")


def test_centerline_lines_points_and_radii(tmp_path: Path) -> None:
    points = np.array([[0.0, 0, 0], [0, 0, 3], [0, 4, 3], [5, 0, 3]])
    write_vtp(tmp_path / "c.vtp", points, {"Lines": [[0, 1, 2], [1, 3]]}, np.array([4.0, 3, 2, 1]))
    first, second = read_centerline(tmp_path / "c.vtp").lines
    np.testing.assert_array_equal(first.points_mm, points[[0, 1, 2]])
    np.testing.assert_array_equal(first.radius_mm, [4, 3, 2])
    np.testing.assert_array_equal(second.points_mm, points[[1, 3]])
    assert (first.length_mm, second.length_mm) == (7, 5)


def test_centerlines_that_are_none_are_refused(tmp_path: Path) -> None:
    write_vtp(tmp_path / "bare.vtp", np.eye(3), {"Lines": [[0, 1, 2]]})
    with pytest.raises(InputError, match=r"bare\.vtp: expected polylines.*received 1 lines and no radius"):
        read_centerline(tmp_path / "bare.vtp")
    write_vtp(tmp_path / "point.vtp", np.eye(3), {"Lines": [[0]]}, np.ones(3))
    with pytest.raises(InputError, match=r"point\.vtp: points_mm: expected at least 2 points"):
        read_centerline(tmp_path / "point.vtp")
    with pytest.raises(InputError, match=r"c\.csv: expected a file"):
        read_centerline(tmp_path / "c.csv")
    (tmp_path / "c.csv").write_text("0,0,0,0,1")
    with pytest.raises(InputError, match=r"c\.csv: expected a centerline as \.vtp"):
        read_centerline(tmp_path / "c.csv")


def test_the_real_aorta_and_its_centerline(real_data: Path) -> None:
    mesh = read_surface(real_data / "vmtk" / "aorta-surface.stl")
    assert isinstance(mesh, Mesh)
    assert len(mesh.vertices_mm) == 6468
    a, b, c = np.moveaxis(mesh.corners_mm, 1, 0)
    assert abs(np.einsum("ni,ni->n", a, np.cross(b, c)).sum() / 6) == pytest.approx(13184, rel=1e-3)
    centerline = read_centerline(real_data / "vmtk" / "aorta-centerline.vtp")
    assert [round(line.length_mm, 1) for line in centerline.lines] == [77.8, 76.2]
    assert sum(len(line.points_mm) for line in centerline.lines) == 409
    radius_mm = np.concatenate([line.radius_mm for line in centerline.lines])
    assert (round(radius_mm.min(), 1), round(radius_mm.max(), 1)) == (2.8, 7.6)
