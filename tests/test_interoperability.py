"""Files that are written here are read by other people's libraries, and theirs here, with the same numbers."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import nibabel
import nrrd
import numpy as np
import pytest
import SimpleITK
import trimesh
import vtk
from scipy.spatial.transform import Rotation
from sweeps import known_sweep
from vessels import bent_tube
from vtk.util.numpy_support import vtk_to_numpy

from registration.ct_model.label_map import read_label_map
from registration.geometry.shapes import Centerline, Mesh, Polyline
from registration.io.centerlines import write_centerline
from registration.io.displacement_fields import (
    DisplacementGrid,
    write_displacement_grid,
    write_displacement_transform,
)
from registration.io.landmarks import Landmarks, write_landmarks
from registration.io.patient_space import write_model
from registration.io.surfaces import read_surface, write_surface
from registration.io.transforms import write_transform
from registration.readers.plus.writer import write_plus

TUBE = bent_tube()
ROTATION = Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()


def same_surface(vertices: np.ndarray, triangles: np.ndarray, atol: float = 1e-4) -> None:
    """Whether the corners of all triangles lie where those of the tube do, however the vertices are numbered."""
    np.testing.assert_allclose(vertices[triangles], TUBE.vertices_mm[TUBE.triangles], atol=atol)


@pytest.mark.parametrize("name", ["model.ply", "model.stl"])
def test_models_are_read_by_trimesh_and_vtk(tmp_path: Path, name: str) -> None:
    write_model(tmp_path / name, TUBE)
    mesh = trimesh.load_mesh(tmp_path / name, process=False)
    same_surface(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    assert mesh.area == pytest.approx(TUBE.areas_mm2.sum(), rel=1e-5)
    reader: Any = vtk.vtkPLYReader() if name.endswith("ply") else vtk.vtkSTLReader()
    reader.SetFileName(str(tmp_path / name))
    reader.Update()
    found = reader.GetOutput()
    cells = vtk_to_numpy(found.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    same_surface(vtk_to_numpy(found.GetPoints().GetData()), cells)


def test_surfaces_and_clouds_are_read_by_trimesh(tmp_path: Path) -> None:
    write_surface(tmp_path / "surface.ply", TUBE)
    mesh = trimesh.load_mesh(tmp_path / "surface.ply", process=False)
    same_surface(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    write_surface(tmp_path / "cloud.ply", TUBE.vertices_mm)
    np.testing.assert_allclose(trimesh.load(tmp_path / "cloud.ply").vertices, TUBE.vertices_mm, atol=1e-4)
    write_surface(tmp_path / "cloud.xyz", TUBE.vertices_mm)
    np.testing.assert_allclose(np.loadtxt(tmp_path / "cloud.xyz"), TUBE.vertices_mm, rtol=1e-9)


@pytest.mark.parametrize("suffix", ["ply", "stl", "obj"])
def test_meshes_of_trimesh_are_read_here(tmp_path: Path, suffix: str) -> None:
    mesh = trimesh.Trimesh(TUBE.vertices_mm, TUBE.triangles, process=False)
    mesh.export(tmp_path / f"theirs.{suffix}")
    found = read_surface(tmp_path / f"theirs.{suffix}")
    assert isinstance(found, Mesh)
    same_surface(found.vertices_mm, found.triangles)


def test_a_centerline_is_read_by_vtk_with_its_radii(tmp_path: Path) -> None:
    points_mm = np.column_stack([np.arange(5.0), np.zeros(5), np.arange(5.0) ** 2])
    line = Polyline(points_mm, np.linspace(2.0, 3.0, 5))
    write_centerline(tmp_path / "line.vtp", Centerline((line,)))
    reader: Any = vtk.vtkXMLPolyDataReader()
    reader.SetFileName(str(tmp_path / "line.vtp"))
    reader.Update()
    found = reader.GetOutput()
    assert found.GetNumberOfLines() == 1
    np.testing.assert_allclose(vtk_to_numpy(found.GetPoints().GetData()), points_mm, atol=1e-5)
    radii = vtk_to_numpy(found.GetPointData().GetArray("MaximumInscribedSphereRadius"))
    np.testing.assert_allclose(radii, line.radius_mm, atol=1e-5)


@pytest.mark.parametrize("name", ["pose.tfm", "pose.h5"])
def test_a_transform_moves_points_the_same_way_in_itk(tmp_path: Path, name: str) -> None:
    fixed_T_moving = np.eye(4)
    fixed_T_moving[:3, :3], fixed_T_moving[:3, 3] = ROTATION, (10.0, -4.0, 7.5)
    write_transform(tmp_path / name, fixed_T_moving)
    # A transform of ITK maps points of the fixed space to the moving one.
    theirs = SimpleITK.ReadTransform(str(tmp_path / name)).GetInverse()
    point = np.array([3.0, 20.0, -8.0])
    expected = fixed_T_moving[:3, :3] @ point + fixed_T_moving[:3, 3]
    np.testing.assert_allclose(theirs.TransformPoint(point.tolist()), expected, atol=1e-9)


@pytest.fixture
def grid() -> DisplacementGrid:
    rng = np.random.default_rng(0)
    return DisplacementGrid(
        np.array([-5.0, 2.0, 30.0]), np.array([2.0, 3.0, 4.0]), rng.normal(size=(4, 3, 2, 3))
    )


def test_a_displacement_field_is_read_by_pynrrd_with_its_axes(tmp_path: Path, grid: DisplacementGrid) -> None:
    write_displacement_grid(tmp_path / "field.nrrd", grid, "lps")
    values, header = nrrd.read(str(tmp_path / "field.nrrd"))
    assert header["space"] == "left-posterior-superior"
    assert header["kinds"][0] == "vector"
    np.testing.assert_allclose(np.moveaxis(values, 0, -1), grid.displacement_mm, atol=1e-12)
    np.testing.assert_allclose(header["space origin"], grid.origin_mm)
    np.testing.assert_allclose(header["space directions"][1:], np.diag(grid.spacing_mm))


def test_a_displacement_field_moves_points_the_same_way_in_itk(
    tmp_path: Path, grid: DisplacementGrid
) -> None:
    write_displacement_transform(tmp_path / "field.h5", grid, "lps")
    theirs = SimpleITK.ReadTransform(str(tmp_path / "field.h5"))
    node = grid.origin_mm + np.array([1, 1, 0]) * grid.spacing_mm
    expected = node + grid.displacement_mm[1, 1, 0]
    np.testing.assert_allclose(theirs.TransformPoint(node.tolist()), expected, atol=1e-9)


@pytest.mark.parametrize("name", ["sweep.igs.mha", "sweep.igs.nrrd"])
def test_a_sequence_is_read_by_itk_and_pynrrd(tmp_path: Path, name: str) -> None:
    sweep = known_sweep()
    dropped = write_plus(tmp_path / name, sweep, max_gap_s=10.0)
    kept = len(sweep.images) - sum(dropped.values())
    image = SimpleITK.ReadImage(str(tmp_path / name))
    frames = SimpleITK.GetArrayFromImage(image)
    if name.endswith("nrrd"):  # ITK takes an axis of the kind "list" for the values of a pixel
        frames = np.moveaxis(frames, -1, 0)
    assert frames.shape == (kept, *sweep.images.shape[1:])
    assert all(any(np.array_equal(frame, own) for own in sweep.images) for frame in frames)
    if name.endswith("nrrd"):
        values, header = nrrd.read(str(tmp_path / name))
        np.testing.assert_array_equal(values.T if values.shape[-1] == kept else values, frames)
        assert any("Transform" in key for key in header)


def test_landmarks_are_what_3d_slicer_writes(tmp_path: Path) -> None:
    points_mm = np.array([[1.0, 2.0, 3.0], [-4.0, 5.5, 6.0]])
    write_landmarks(tmp_path / "bifurcation.mrk.json", Landmarks(("a", "b"), points_mm))
    content = json.loads((tmp_path / "bifurcation.mrk.json").read_text())
    assert "markups-schema" in content["@schema"]
    (markup,) = content["markups"]
    assert (markup["type"], markup["coordinateSystem"], markup["coordinateUnits"]) == (
        "Fiducial",
        "LPS",
        "mm",
    )
    assert [point["position"] for point in markup["controlPoints"]] == points_mm.tolist()
    assert len({point["id"] for point in markup["controlPoints"]}) == 2


def test_a_displacement_field_is_read_by_slicerio(tmp_path: Path, grid: DisplacementGrid) -> None:
    import slicerio

    write_displacement_grid(tmp_path / "field.nrrd", grid, "lps")
    volume = slicerio.read_volume(str(tmp_path / "field.nrrd"))
    vectors_mm = np.moveaxis(slicerio.component_vectors_to_lps(volume), 0, -1)
    np.testing.assert_allclose(vectors_mm, grid.displacement_mm, atol=1e-12)
    origin_mm, far_mm = (volume["ijkToLPS"] @ [*node, 1] for node in ((0, 0, 0), (3, 2, 1)))
    np.testing.assert_allclose(origin_mm[:3], grid.origin_mm)
    np.testing.assert_allclose(far_mm[:3], grid.far_corner_mm)


def test_a_label_map_of_nibabel_lies_where_nibabel_says(tmp_path: Path) -> None:
    labels = np.zeros((6, 5, 4), dtype=np.uint8)
    labels[1, 3, 2] = 1
    affine = np.eye(4)
    affine[:3, :3], affine[:3, 3] = ROTATION * [0.7, 0.8, 1.5], (-20.0, 11.0, 5.0)
    nibabel.save(nibabel.Nifti1Image(labels, affine), tmp_path / "labels.nii.gz")
    found = read_label_map(tmp_path / "labels.nii.gz")
    # NIfTI counts right and anterior, everything here left and posterior.
    ras = nibabel.load(tmp_path / "labels.nii.gz").affine @ [1, 3, 2, 1]
    ours = found.ct_A_voxel @ [1, 3, 2, 1]
    np.testing.assert_allclose(ours[:3], ras[:3] * [-1, -1, 1], atol=1e-4)
    assert found.labels[1, 3, 2] == 1 and found.labels.sum() == 1


def test_a_label_map_of_pynrrd_lies_where_its_header_says(tmp_path: Path) -> None:
    labels = np.zeros((6, 5, 4), dtype=np.uint8)
    labels[4, 1, 2] = 1
    header = {
        "space": "left-posterior-superior",
        "space directions": (ROTATION * [0.7, 0.8, 1.5]).T,
        "space origin": [3.0, -4.0, 5.0],
    }
    nrrd.write(str(tmp_path / "labels.nrrd"), labels, header)
    found = read_label_map(tmp_path / "labels.nrrd")
    expected = (ROTATION * [0.7, 0.8, 1.5]) @ [4, 1, 2] + [3.0, -4.0, 5.0]
    np.testing.assert_allclose((found.ct_A_voxel @ [4, 1, 2, 1])[:3], expected, atol=1e-9)
    assert found.labels[4, 1, 2] == 1 and found.labels.sum() == 1
