"""All files of a registration read together: what each is, what is known, and which were used."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from vessels import bent_tube

from experiments.errors import InputError
from experiments.studies.register.pair import SideFiles, read_pair
from registration import transforms
from registration.geometry.shapes import Centerline, Mesh, Polyline
from registration.io.centerlines import write_centerline
from registration.io.surfaces import write_surface
from registration.io.transforms import write_transform

TUBE = bent_tube(along=40, around=12)
MARKED = TUBE.vertices_mm[[0, 100, 300, 450]]
INNER = TUBE.vertices_mm[:480].reshape(40, 12, 3).mean(axis=1)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_surface(tmp_path / "moving.ply", TUBE)
    write_surface(tmp_path / "fixed.ply", TUBE)
    write_landmarks(tmp_path / "moving.mrk.json", MARKED)
    write_landmarks(tmp_path / "fixed.mrk.json", MARKED + np.array([10.0, 0.0, 0.0]))
    return tmp_path


def write_landmarks(path: Path, points_mm: np.ndarray, space: str = "LPS", first: str = "F-0") -> None:
    names = [first, *(f"F-{row}" for row in range(1, len(points_mm)))]
    control = [
        {"label": name, "position": point} for name, point in zip(names, points_mm.tolist(), strict=True)
    ]
    path.write_text(json.dumps({"markups": [{"coordinateSystem": space, "controlPoints": control}]}))


def side(folder: Path, name: str, *, marked: bool = False, **change: str) -> SideFiles:
    landmarks = {"landmarks": str(folder / f"{name}.mrk.json")} if marked else {}
    return SideFiles(name, **({"path": str(folder / f"{name}.ply")} | landmarks | change))


def test_every_file_that_was_read_is_an_input(folder: Path) -> None:
    write_centerline(folder / "fixed-centerline.csv", Centerline((Polyline(INNER, np.full(40, 4.0)),)))
    write_transform(folder / "known.tfm", transforms.translation((1.0, 0.0, 0.0)))
    pair = read_pair(
        side(folder, "moving", marked=True), side(folder, "fixed", marked=True), str(folder / "known.tfm")
    )
    assert [data.name for data in pair.inputs] == [
        "moving.ply",
        "fixed.ply",
        "fixed-centerline.csv",
        "moving.mrk.json",
        "fixed.mrk.json",
        "known.tfm",
    ]
    assert pair.moving.centerline_mm(50) is None
    line_mm = pair.fixed.centerline_mm(50)
    assert line_mm is not None and 40 <= len(line_mm) <= 50


def test_landmarks_lead_unless_a_pose_is_given(folder: Path) -> None:
    moving, fixed = side(folder, "moving", marked=True), side(folder, "fixed", marked=True)
    led = read_pair(moving, fixed)
    assert led.initial is not None and led.initial.source == "landmarks"
    np.testing.assert_allclose(
        led.initial.fixed_T_moving, transforms.translation((10.0, 0.0, 0.0)), atol=1e-9
    )
    write_transform(folder / "known.h5", transforms.translation((1.0, 0.0, 0.0)))
    told = read_pair(moving, fixed, str(folder / "known.h5"), 12.0)
    assert told.initial is not None and told.initial.source == "file"
    assert told.initial.search_cone is not None and told.initial.search_cone.angle_deg == 12.0
    assert told.landmarks is not None
    assert read_pair(side(folder, "moving"), side(folder, "fixed")).initial is None


def test_landmarks_in_ras_are_the_same_landmarks(folder: Path) -> None:
    write_landmarks(folder / "moving.mrk.json", MARKED * [-1.0, -1.0, 1.0], "RAS")
    pair = read_pair(side(folder, "moving", marked=True), side(folder, "fixed", marked=True))
    assert pair.landmarks is not None
    np.testing.assert_allclose(pair.landmarks.moving_mm, MARKED)


def test_a_surface_turned_from_its_landmarks_is_refused_unless_its_axes_are_said(folder: Path) -> None:
    write_surface(folder / "fixed.ply", Mesh(TUBE.vertices_mm * [-1.0, -1.0, 1.0], TUBE.triangles))
    moving, fixed = side(folder, "moving", marked=True), side(folder, "fixed", marked=True)
    with pytest.raises(
        InputError, match=r"fixed_space: expected the axes of .*fixed\.ply.*pass fixed_space=ras or lps"
    ):
        read_pair(moving, fixed)
    read_pair(moving, side(folder, "fixed", marked=True, space="lps"))
    righted = read_pair(moving, side(folder, "fixed", marked=True, space="ras"))
    assert isinstance(righted.fixed.surface, Mesh)
    np.testing.assert_allclose(righted.fixed.surface.vertices_mm, TUBE.vertices_mm, atol=1e-6)


def test_landmarks_that_belong_to_something_else_say_nothing_about_axes(folder: Path) -> None:
    write_landmarks(folder / "moving.mrk.json", MARKED + np.array([500.0, 0.0, 0.0]))
    assert (
        read_pair(side(folder, "moving", marked=True), side(folder, "fixed", marked=True)).landmarks
        is not None
    )


@pytest.mark.parametrize(
    "marks, message",
    [
        (MARKED[:2], "landmarks: expected at least 3 pairs"),
        (
            np.outer(np.arange(4.0), [3.0, 1.0, 2.0]) + MARKED[0],
            "moving_landmarks: expected landmarks that span a plane",
        ),
    ],
    ids=["too few", "on a line"],
)
def test_landmarks_that_give_no_pose_are_refused(folder: Path, marks: np.ndarray, message: str) -> None:
    write_landmarks(folder / "moving.mrk.json", marks)
    write_landmarks(folder / "fixed.mrk.json", MARKED[: len(marks)])
    with pytest.raises(InputError, match=message) as refusal:
        read_pair(side(folder, "moving", marked=True), side(folder, "fixed", marked=True))
    assert "\n" not in str(refusal.value)


def test_landmarks_of_other_names_are_refused(folder: Path) -> None:
    write_landmarks(folder / "moving.mrk.json", MARKED, first="ostium")
    with pytest.raises(
        InputError, match="moving_landmarks: expected the same names on both sides, received ostium"
    ):
        read_pair(side(folder, "moving", marked=True), side(folder, "fixed", marked=True))


def test_landmarks_on_one_side_are_refused(folder: Path) -> None:
    with pytest.raises(
        InputError, match="fixed_landmarks: expected a file next to moving_landmarks, received none"
    ):
        read_pair(side(folder, "moving", marked=True), side(folder, "fixed"))


@pytest.mark.parametrize(
    "matrix, message",
    [
        (np.diag([1.0, 1, -1, 1]), "expected a right-handed rotation, received a mirrored one"),
        (np.diag([1.0, 1, 1.1, 1]), "expected orthonormal rotations"),
        (np.diag([1e-3, 1e-3, 1e-3, 1]), "expected orthonormal rotations"),
        (np.eye(3), "expected fixed_T_moving as 4 rows of 4 numbers"),
    ],
    ids=["left-handed", "stretched", "scaled", "3x3"],
)
def test_a_pose_that_is_not_rigid_is_refused(folder: Path, matrix: np.ndarray, message: str) -> None:
    (folder / "known.json").write_text(json.dumps({"fixed_T_moving": matrix.tolist()}))
    with pytest.raises(InputError, match=f"initial: .*{message}"):
        read_pair(side(folder, "moving"), side(folder, "fixed"), str(folder / "known.json"))


def test_clouds_whose_sizes_differ_a_hundredfold_are_refused(folder: Path) -> None:
    write_surface(folder / "fixed.ply", Mesh(200.0 * TUBE.vertices_mm, TUBE.triangles))
    with pytest.raises(InputError, match=r"moving: expected millimetres.*pass moving_unit=m"):
        read_pair(side(folder, "moving"), side(folder, "fixed"))
    read_pair(side(folder, "moving", unit="mm"), side(folder, "fixed"))
