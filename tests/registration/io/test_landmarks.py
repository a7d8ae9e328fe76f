"""Landmarks of 3D Slicer: both formats, both spellings of the axes, pairs by name, and the pose they give."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.errors import InputError
from registration.io.landmarks import LandmarkPairs, Landmarks, paired, read_landmarks, write_landmarks

# Three points in LPS, and the same in RAS.
LPS = np.array([[10.0, 20.0, 30.0], [-5.0, 4.0, 1.0], [0.0, -8.0, 2.5]])
RAS = LPS * [-1.0, -1.0, 1.0]
NAMES = ("ostium", "apex", "branch")


def markups(
    points: np.ndarray, space: str | None = "LPS", names: tuple[str, ...] = NAMES, **change: Any
) -> str:
    control = [
        {"id": str(row), "label": name, "position": point, "positionStatus": "defined"}
        for row, (name, point) in enumerate(zip(names, points.tolist(), strict=True))
    ]
    markup = {
        "type": "Fiducial",
        "coordinateSystem": space,
        "coordinateUnits": "mm",
        "controlPoints": control,
    }
    return json.dumps(
        {"markups": [{key: value for key, value in (markup | change).items() if value is not None}]}
    )


def fcsv(points: np.ndarray, space: str | None = "LPS") -> str:
    lines = ["# Markups fiducial file version = 4.11"]
    lines += [] if space is None else [f"# CoordinateSystem = {space}"]
    lines.append("# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID")
    for row, (name, (x, y, z)) in enumerate(zip(NAMES, points, strict=True)):
        lines.append(f'vtkMRMLMarkupsFiducialNode_{row},{x},{y},{z},0,0,0,1,1,1,0,{name},"a, b",')
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    "name, text",
    [
        ("a.mrk.json", markups(LPS)),
        ("a.mrk.json", markups(RAS, "RAS")),
        ("a.fcsv", fcsv(LPS)),
        ("a.fcsv", fcsv(RAS, "RAS")),
        ("a.fcsv", fcsv(RAS, "0")),
        ("a.fcsv", fcsv(LPS, "1")),
    ],
)
def test_the_header_says_which_way_the_axes_point(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    found = read_landmarks(tmp_path / name)
    assert found.names == NAMES
    np.testing.assert_allclose(found.points_mm, LPS)


def test_points_never_placed_are_left_out(tmp_path: Path) -> None:
    content = json.loads(markups(LPS))
    content["markups"][0]["controlPoints"].append(
        {"label": "later", "position": [0, 0, 0], "positionStatus": "undefined"}
    )
    (tmp_path / "a.mrk.json").write_text(json.dumps(content))
    assert read_landmarks(tmp_path / "a.mrk.json").names == NAMES


def test_unplaced_points_of_fcsv_are_left_out(tmp_path: Path) -> None:
    """Slicer 5 adds the state of the position and the point's origin to a row; its header names neither."""
    rows = fcsv(LPS).splitlines()
    rows[3:] = [f"{row}2,0" if row.endswith(",") else f"{row},2,0" for row in rows[3:]]
    later = 'later,0,0,0,0,0,0,1,1,1,0,F-{},"",,{},0'
    rows = [row.replace('"a, b",2,0', '"a, b",,2,0') for row in rows]
    rows += [later.format(state, state) for state in (0, 1, 3)]
    (tmp_path / "a.fcsv").write_text("\n".join(rows) + "\n")
    found = read_landmarks(tmp_path / "a.fcsv")
    assert found.names == NAMES
    np.testing.assert_allclose(found.points_mm, LPS)


def test_columns_of_fcsv_stand_where_the_header_says(tmp_path: Path) -> None:
    lines = ["# CoordinateSystem = RAS", "# columns = label,z,positionStatus,y,x"]
    lines += [f"{name},{z},2,{y},{x}" for name, (x, y, z) in zip(NAMES, RAS, strict=True)]
    lines += ["later,0,0,0,0", "seen,0,preview,0,0"]
    (tmp_path / "a.fcsv").write_text("\r\n".join(lines))
    found = read_landmarks(tmp_path / "a.fcsv")
    assert found.names == NAMES
    np.testing.assert_allclose(found.points_mm, LPS)


@pytest.mark.parametrize(
    "units, scale",
    [
        ("mm", 1),
        (["mm", "UCUM", "millimeter"], 1),
        ("m", 1000),
        (["m", "UCUM"], 1000),
        (["cm", "UCUM", "cm"], 10),
    ],
)
def test_units_of_length_are_converted(tmp_path: Path, units: object, scale: float) -> None:
    (tmp_path / "a.mrk.json").write_text(markups(LPS / scale, coordinateUnits=units))
    np.testing.assert_allclose(read_landmarks(tmp_path / "a.mrk.json").points_mm, LPS)


@pytest.mark.parametrize("name, text", [("a.mrk.json", markups(LPS)), ("a.fcsv", fcsv(LPS))])
@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_byte_order_marks(tmp_path: Path, name: str, text: str, encoding: str) -> None:
    (tmp_path / name).write_bytes(text.encode(encoding))
    np.testing.assert_allclose(read_landmarks(tmp_path / name).points_mm, LPS)


@pytest.mark.parametrize(
    "name, text, message",
    [
        ("a.mrk.json", markups(LPS, None), "expected a header that names its axes LPS or RAS, received none"),
        ("a.fcsv", fcsv(LPS, None), "expected a header that names its axes LPS or RAS, received none"),
        ("a.fcsv", fcsv(LPS, "2"), "expected a header that names its axes LPS or RAS, received 2"),
        ("a.mrk.json", markups(LPS, "scanner"), "LPS or RAS, received scanner"),
        (
            "a.mrk.json",
            markups(LPS, coordinateUnits="inch"),
            "expected coordinateUnits of mm, .* received inch",
        ),
        ("a.mrk.json", markups(LPS, coordinateUnits=["mm", "DCM", "mm"]), "expected coordinateUnits of mm"),
        ("a.mrk.json", markups(LPS[:, :2]), "expected three coordinates a point"),
        ("a.mrk.json", markups(LPS).replace("10.0", '"1_0"'), "expected landmarks as 3D Slicer writes them"),
        (
            "a.mrk.json",
            markups(LPS, names=("a", "b", "a")),
            "expected a name of its own for each, received a twice",
        ),
        ("a.mrk.json", markups(LPS * np.nan), "expected finite coordinates"),
        ("a.mrk.json", markups(LPS)[:70], "expected landmarks as 3D Slicer writes them"),
        ("a.mrk.json", "{}", "expected landmarks as 3D Slicer writes them"),
        ("a.mrk.json", "[1]", "expected landmarks as 3D Slicer writes them"),
        (
            "a.fcsv",
            fcsv(LPS).replace("columns", "nothing"),
            "expected the columns x, y, z and label, received none",
        ),
        ("a.fcsv", fcsv(LPS)[:-50], "expected 14 fields a row, received 1 in"),
        ("a.fcsv", fcsv(LPS).replace("10.0,20.0", "10,0,20,0"), "expected 14 fields a row, received 16"),
        ("a.fcsv", fcsv(LPS).replace("10.0,", "1_0,"), "expected landmarks as 3D Slicer writes them"),
        ("a.fcsv", fcsv(LPS).replace("10.0", "ten"), "expected landmarks as 3D Slicer writes them"),
        ("a.txt", "1 2 3", "expected landmarks as .mrk.json or .fcsv, received .txt"),
    ],
)
def test_a_file_that_cannot_be_trusted_is_refused_by_name(
    tmp_path: Path, name: str, text: str, message: str
) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=message) as refusal:
        read_landmarks(tmp_path / name)
    assert name in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected a file, received nothing there"):
        read_landmarks(tmp_path / "none.fcsv")


def test_two_lists_in_different_axes_are_refused(tmp_path: Path) -> None:
    lists = [json.loads(markups(LPS, space))["markups"][0] for space in ("LPS", "RAS")]
    (tmp_path / "a.mrk.json").write_text(json.dumps({"markups": lists}))
    with pytest.raises(InputError, match="expected one coordinateSystem, received LPS, RAS"):
        read_landmarks(tmp_path / "a.mrk.json")


def test_pairs_follow_names_and_give_the_pose_without_scale() -> None:
    """The fixed points are the moving ones half as large again, turned and moved: the pose has no part of the size."""
    pose = transforms.from_rotation(Rotation.from_rotvec([0.3, -2.0, 1.0]), np.array([100.0, -20, 3]))
    order = [2, 0, 1]
    centre = LPS.mean(axis=0)
    grown = transforms.apply(pose, centre + 1.5 * (LPS - centre))
    pairs = paired(Landmarks(NAMES, LPS), Landmarks(tuple(NAMES[row] for row in order), grown[order]))
    assert pairs.names == NAMES
    np.testing.assert_allclose(pairs.fixed_mm, grown)
    np.testing.assert_allclose(pairs.fixed_T_moving, pose, atol=1e-9)
    # What is left is the growth: half the distance to the centre.
    expected = 0.5 * np.linalg.norm(LPS - centre, axis=1)
    np.testing.assert_allclose(pairs.errors_mm(pose), expected, atol=1e-9)


def test_mirrored_landmarks_do_not_give_a_mirror() -> None:
    corners = np.array([[0.0, 0, 0], [30, 0, 0], [0, 20, 0], [0, 0, 10]])
    pairs = LandmarkPairs(("a", "b", "c", "d"), corners, corners * [1.0, 1.0, -1.0])
    assert np.linalg.det(pairs.fixed_T_moving[:3, :3]) == pytest.approx(1.0)
    assert pairs.errors_mm(pairs.fixed_T_moving).max() > 1


def test_names_on_one_side_only_are_refused() -> None:
    other = Landmarks(("ostium", "apex", "valve"), LPS)
    with pytest.raises(
        InputError, match="moving_landmarks: expected the same names on both sides, received branch"
    ):
        paired(Landmarks(NAMES, LPS), other)
    with pytest.raises(
        InputError, match="fixed_landmarks: expected the same names on both sides, received branch"
    ):
        paired(Landmarks(NAMES[:2], LPS[:2]), Landmarks(NAMES, LPS))


def test_fewer_than_three_pairs_are_refused() -> None:
    two = Landmarks(NAMES[:2], LPS[:2])
    with pytest.raises(
        InputError, match="landmarks: expected at least 3 pairs with the same names, received 2"
    ):
        paired(two, two)


def test_landmarks_on_one_line_are_refused() -> None:
    line = np.outer(np.arange(3.0), [1.0, 2.0, -1.0])
    with pytest.raises(InputError, match="fixed_landmarks: expected landmarks that span a plane"):
        paired(Landmarks(NAMES, LPS), Landmarks(NAMES, line))
    with pytest.raises(InputError, match="moving_landmarks: expected landmarks that span a plane"):
        paired(Landmarks(NAMES, np.ones((3, 3))), Landmarks(NAMES, LPS))


def test_a_name_for_each_point() -> None:
    with pytest.raises(InputError, match="names: expected one for each of 3 points, received 2"):
        Landmarks(NAMES[:2], LPS)


def test_written_landmarks_are_read_back_by_name(tmp_path: Path) -> None:
    points_mm = np.array([[1.5, -2.25, 300.125], [0.0, 0.0, 0.0], [-4.0, 5.0, 6.0]])
    write_landmarks(tmp_path / "set.mrk.json", Landmarks(("bifurcation", "ä 1", "end"), points_mm))
    found = read_landmarks(tmp_path / "set.mrk.json")
    assert found.names == ("bifurcation", "ä 1", "end")
    np.testing.assert_allclose(found.points_mm, points_mm, atol=1e-6)
    (markup,) = json.loads((tmp_path / "set.mrk.json").read_text())["markups"]
    assert (markup["type"], markup["coordinateSystem"], markup["coordinateUnits"]) == (
        "Fiducial",
        "LPS",
        "mm",
    )
