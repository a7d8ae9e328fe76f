"""Centerlines written and read back, and what 3D Slicer expects of a curve."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from registration.errors import InputError
from registration.geometry.shapes import Centerline, Polyline
from registration.io.centerlines import read_centerline_table, write_centerline
from registration.io.surfaces import read_centerline

TWO = Centerline(
    (
        Polyline(np.array([[1.0, 2, 3], [4, 5, 6], [7, 8, 9.25]]), np.array([1.5, 2.5, 3.5])),
        Polyline(np.array([[1.0, 2, 3], [-1, -2, 0.125]]), np.array([1.5, 0.75])),
    )
)


def same(found: Centerline, expected: Centerline) -> None:
    assert len(found.lines) == len(expected.lines)
    for ours, theirs in zip(found.lines, expected.lines, strict=True):
        np.testing.assert_allclose(ours.points_mm, theirs.points_mm, atol=1e-6)
        np.testing.assert_allclose(ours.radius_mm, theirs.radius_mm, atol=1e-6)


def test_polylines_are_read_back(tmp_path: Path) -> None:
    write_centerline(tmp_path / "centerline.vtp", TWO)
    same(read_centerline(tmp_path / "centerline.vtp"), TWO)
    assert [path.name for path in tmp_path.iterdir()] == ["centerline.vtp"]


def test_the_table_by_hand_and_read_back(tmp_path: Path) -> None:
    write_centerline(tmp_path / "centerline.csv", TWO)
    rows = (tmp_path / "centerline.csv").read_text().splitlines()
    assert rows[0] == "line,x,y,z,radius_mm"
    assert rows[3] == "0,7.000000,8.000000,9.250000,3.500000"
    assert rows[5].startswith("1,-1.000000")
    same(read_centerline_table(tmp_path / "centerline.csv"), TWO)


def test_curves_for_slicer_say_their_axes_and_unit(tmp_path: Path) -> None:
    write_centerline(tmp_path / "centerline.mrk.json", TWO, space="RAS")
    written = json.loads((tmp_path / "centerline.mrk.json").read_text())
    assert "markups-schema" in written["@schema"]
    first, second = written["markups"]
    assert (first["type"], first["coordinateSystem"], first["coordinateUnits"]) == ("Curve", "RAS", "mm")
    assert [point["position"] for point in second["controlPoints"]] == [[1, 2, 3], [-1, -2, 0.125]]
    assert len({point["id"] for point in first["controlPoints"]}) == 3


def test_other_files_and_axes_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"expected \.csv, \.vtp or \.mrk\.json"):
        write_centerline(tmp_path / "centerline.json", TWO)
    with pytest.raises(InputError, match="space: expected LPS or RAS"):
        write_centerline(tmp_path / "centerline.csv", TWO, space="XYZ")


@pytest.mark.parametrize(
    "text, message",
    [
        ("x,y,z\n1,2,3\n", "expected the columns line, x, y, z, radius_mm, received x, y, z"),
        ("", "received an empty file"),
        ("line,x,y,z,radius_mm\n0,1,2,three,4\n", "expected five numbers a row"),
        ("line,x,y,z,radius_mm\n0,1,2,3,4\n", "expected at least 2 points a line"),
        ("line,x,y,z,radius_mm\n0,1,5,2,5,3,5,4,0,1\n0,1,5,2,5,3,5,4,0,1\n", "expected five numbers a row"),
        ("line,x,y,z,radius_mm\n", "expected at least one line"),
    ],
)
def test_bad_tables_are_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "table.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        read_centerline_table(tmp_path / "table.csv")
    with pytest.raises(InputError, match="expected a file, received nothing there"):
        read_centerline_table(tmp_path / "none.csv")


def test_a_table_with_a_byte_order_mark(tmp_path: Path) -> None:
    (tmp_path / "c.csv").write_bytes(
        "line,x,y,z,radius_mm\r\n0,0,0,0,2\r\n0,3,4,0,2\r\n\r\n".encode("utf-8-sig")
    )
    assert read_centerline_table(tmp_path / "c.csv").length_mm == 5
