"""One vessel from files of every kind: always the same surface in mm in LPS, or one clear sentence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import open3d
import pytest
from tubes import straight, tube
from vessels import bent_tube
from volumes import OBLIQUE, nrrd_bytes, voxelised, write_volume

from registration.ct_model.label_map import LabelMap
from registration.ct_model.label_surface import LabelSurface
from registration.ct_model.loader import read_model
from registration.errors import InputError
from registration.geometry.shapes import Mesh
from registration.io.patient_space import write_model
from registration.io.surfaces import write_surface

TUBE = bent_tube()
SURFACE = LabelSurface()
RAS = Mesh(TUBE.vertices_mm * [-1.0, -1.0, 1.0], TUBE.triangles)
# The thick end and the thin end: where they are tells a vessel from the same one turned by 180 degrees.
LANDMARKS_MM = TUBE.vertices_mm[[0, -1]]


def balls(points_mm: np.ndarray) -> np.ndarray:
    """A drop: its thick end on the patient's left and in front, its thin one to the right and at the back."""
    thick = np.linalg.norm(points_mm - [50.0, -30.0, 10.0], axis=1) < 9
    share = np.clip((50.0 - points_mm[:, 0]) / 40.0, 0, 1)
    middle = np.stack([50 - 40 * share, -30 + 25 * share, np.full(len(share), 10.0)], axis=1)
    return np.asarray(thick | (np.linalg.norm(points_mm - middle, axis=1) < 4))


DROP = voxelised(
    balls, np.array([5.0, -40.0, 0.0]), np.array([60.0, 0.0, 20.0]), (0.8, 0.9, 1.2), OBLIQUE, label=2
)


@pytest.mark.parametrize("name", ["m.ply", "m.stl", "m.obj"])
def test_lps_and_ras_put_landmarks_where_they_belong(tmp_path: Path, name: str) -> None:
    for space, mesh in (("lps", TUBE), ("ras", RAS)):
        body = open3d.geometry.TriangleMesh(
            open3d.utility.Vector3dVector(mesh.vertices_mm),
            open3d.utility.Vector3iVector(mesh.triangles.astype(np.int32)),
        )
        body.compute_triangle_normals()
        open3d.io.write_triangle_mesh(str(tmp_path / name), body)
        found = read_model(tmp_path / name, SURFACE, space=space)
        apart_mm = np.linalg.norm(found.mesh.vertices_mm[:, None] - LANDMARKS_MM[None], axis=2).min(axis=0)
        np.testing.assert_allclose(apart_mm, 0, atol=1e-3)
        assert found.space == space
    # The wrong choice turns the vessel by 180 degrees about z: a proper rotation that no shape can show.
    turned = read_model(tmp_path / name, SURFACE, space="lps").mesh.vertices_mm
    assert np.linalg.norm(turned[:, None] - LANDMARKS_MM[None], axis=2).min() > 100
    with pytest.raises(InputError, match=rf"space: expected lps or ras, because .*{name} does not say"):
        read_model(tmp_path / name, SURFACE)


def test_a_header_that_states_its_space_is_obeyed(tmp_path: Path) -> None:
    write_model(tmp_path / "m.stl", RAS, "ras")
    found = read_model(tmp_path / "m.stl", SURFACE)
    assert found.space == "ras"
    np.testing.assert_allclose(found.mesh.vertices_mm.min(axis=0), TUBE.vertices_mm.min(axis=0), atol=1e-4)
    read_model(tmp_path / "m.stl", SURFACE, space="ras")
    with pytest.raises(
        InputError, match=r"space: expected ras, as the header of .*m\.stl says, received lps"
    ):
        read_model(tmp_path / "m.stl", SURFACE, space="lps")


def test_a_label_map_and_a_mesh_of_one_vessel_lie_in_one_place(tmp_path: Path) -> None:
    from_nifti = read_model(write_volume(tmp_path / "d.nii.gz", DROP), SURFACE)
    from_nrrd = read_model(write_volume(tmp_path / "d.nrrd", DROP), SURFACE)
    np.testing.assert_allclose(from_nifti.mesh.vertices_mm, from_nrrd.mesh.vertices_mm, atol=1e-3)
    np.testing.assert_allclose(from_nifti.mesh.vertices_mm.max(axis=0), [59, -1, 19], atol=0.8)
    np.testing.assert_allclose(from_nifti.mesh.vertices_mm.min(axis=0), [6, -39, 1], atol=0.8)
    assert from_nifti.mask is not None
    assert (from_nifti.space, from_nifti.units, from_nifti.mask.label) == ("header", "mm", 2)
    write_model(tmp_path / "d.ply", from_nifti.mesh)
    again = read_model(tmp_path / "d.ply", SURFACE)
    np.testing.assert_allclose(
        again.mesh.vertices_mm.mean(axis=0), from_nifti.mesh.vertices_mm.mean(axis=0), atol=1e-3
    )


def test_a_label_map_in_metres(tmp_path: Path) -> None:
    metres = LabelMap(DROP.labels, np.diag([0.001, 0.001, 0.001, 1]) @ DROP.ct_A_voxel, {})
    write_volume(tmp_path / "d.mha", metres)
    with pytest.raises(
        InputError, match=r"d\.mha: expected a vessel in millimetres, .*looks like m: pass units=m"
    ):
        read_model(tmp_path / "d.mha", SURFACE)
    found = read_model(tmp_path / "d.mha", SURFACE, units="m")
    np.testing.assert_allclose(found.mesh.vertices_mm.max(axis=0), [59, -1, 19], atol=0.8)
    assert found.mask is not None
    assert found.mask.volume_mm3 == pytest.approx(float((DROP.labels > 0).sum()) * 0.8 * 0.9 * 1.2, rel=1e-3)


def test_a_mesh_in_centimetres(tmp_path: Path) -> None:
    write_model(tmp_path / "m.ply", Mesh(TUBE.vertices_mm / 10, TUBE.triangles))
    with pytest.raises(InputError, match=r"m\.ply: .*looks like cm: pass units=cm"):
        read_model(tmp_path / "m.ply", SURFACE)
    found = read_model(tmp_path / "m.ply", SURFACE, units="cm")
    assert found.units == "cm"
    np.testing.assert_allclose(
        np.ptp(found.mesh.vertices_mm, axis=0), np.ptp(TUBE.vertices_mm, axis=0), rtol=1e-4
    )


def test_a_name_of_3d_slicer_goes_with_the_label(tmp_path: Path) -> None:
    more = "Segment0_LabelValue:=2\nSegment0_Name:=left femoral artery\n"
    (tmp_path / "d.seg.nrrd").write_bytes(nrrd_bytes(DROP.labels, "LPS", DROP.ct_A_voxel, more))
    assert read_model(tmp_path / "d.seg.nrrd", SURFACE).label_name == "left femoral artery"


def test_what_is_no_model_is_refused(tmp_path: Path) -> None:
    write_surface(tmp_path / "cloud.ply", TUBE.vertices_mm)
    write_surface(tmp_path / "mesh.ply", TUBE)
    write_volume(tmp_path / "empty.nrrd", LabelMap(np.zeros((4, 4, 4), dtype=np.uint8), np.eye(4), {}))
    (tmp_path / "x.step").write_text("")
    for name, settings, message in (
        ("none.ply", {}, r"none\.ply: expected a file, received nothing there"),
        ("x.step", {}, r"x\.step: expected one of \.nii, .*\.vtp, received \.step"),
        (
            "cloud.ply",
            {"space": "lps"},
            r"cloud\.ply: expected a mesh with triangles, received 2562 points alone",
        ),
        (
            "mesh.ply",
            {"space": "lps", "label": 1},
            r"label: expected none, because .*mesh\.ply is a mesh, received 1",
        ),
        ("mesh.ply", {"space": "xyz"}, "space: expected lps or ras, received 'xyz'"),
        ("mesh.ply", {"space": "lps", "units": "inch"}, "units: expected one of mm, cm, m, received 'inch'"),
        ("empty.nrrd", {}, r"empty\.nrrd: labels: expected at least one voxel"),
    ):
        with pytest.raises(InputError, match=message) as refusal:
            read_model(tmp_path / name, SURFACE, **settings)  # type: ignore[arg-type]
        assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_mesh_with_a_place_that_is_none_is_refused(tmp_path: Path, value: float) -> None:
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
    head += "property float z\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n"
    places = np.array([[0, 0, 0], [9, 0, 0], [0, 9, 0], [value, 0, 1]], dtype="<f4").tobytes()
    faces = b"".join(b"\3" + np.array(corners, dtype="<i4").tobytes() for corners in ([0, 1, 2], [0, 1, 3]))
    (tmp_path / "n.ply").write_bytes(head.encode() + places + faces)
    with pytest.raises(
        InputError, match=r"n\.ply: expected finite coordinates, received 1 points with NaN or infinity"
    ):
        read_model(tmp_path / "n.ply", SURFACE, space="lps")


def test_an_open_tube_stays_open_and_its_winding_is_mended(tmp_path: Path) -> None:
    opened = tube(straight(60.0), 4.0)
    write_model(tmp_path / "m.stl", Mesh(opened.vertices_mm, opened.triangles[:, ::-1].copy()))
    found = read_model(tmp_path / "m.stl", SURFACE)
    assert found.repaired is not None
    assert found.repaired.triangles_turned == len(opened.triangles)
    assert found.repaired.mesh is found.mesh
