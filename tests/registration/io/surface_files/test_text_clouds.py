"""Rows of text: what separates numbers, what is a header, and what could be read in two ways."""

from __future__ import annotations

from pathlib import Path

import pytest

from registration.errors import InputError
from registration.io.surface_files.text_clouds import read_text_cloud

POINTS = [[5.279, -0.532, 12.5], [4, 5, -6.25], [7, 8.5, 10]]


def read(tmp_path: Path, text: str, encoding: str = "utf-8") -> list[list[float]]:
    (tmp_path / "c.xyz").write_bytes(text.encode(encoding))
    return read_text_cloud(tmp_path / "c.xyz").points.tolist()


@pytest.mark.parametrize(
    "text",
    [
        "5.279 -0.532 12.5\n4 5 -6.25\n7 8.5 10\n",
        "5.279\t-0.532\t12.5\r\n4\t5\t-6.25\r\n\r\n7\t8.5\t1e1\r\n",
        "5.279,-0.532,12.5\n4,5,-6.25\n7,8.5,10\n",
        "5.279, -0.532, 12.5\n4, 5, -6.25\n7 , 8.5 , 10\n",
        "5.279;-0.532;12.5\n4;5;-6.25\n7;8.5;10\n",
        "5,279;-0,532;12,5\n4;5;-6,25\n7;8,5;10\n",
        "5,279; -0,532; 12,5;\n4; 5; -6,25;\n7; 8,5; 10;\n",
        "5,279 -0,532 12,5\n4 5 -6,25\n7 8,5 10\n",
        "\ufeff5,279\t-0,532\t12,5\n4\t5\t-6,25\n7\t8,5\t10\n",
        "x,y,z\n5.279,-0.532,12.5\n4,5,-6.25\n7,8.5,10\n",
        "X_mm;Y_mm;Z_mm\n5,279;-0,532;12,5\n4;5;-6,25\n7;8,5;10\n",
        '"Points:0","Points:1","Points:2"\n5.279,-0.532,12.5\n4,5,-6.25\n7,8.5,10\n',
        "id,z,y,x\n0,12.5,-0.532,5.279\n1,-6.25,5,4\n2,10,8.5,7\n",
        "# id x y z\n0 5.279 -0.532 12.5\n1 4 5 -6.25\n2 7 8.5 10\n",
        "//X Y Z R G B\n3\n5.279 -0.532 12.5 0 0 0\n4 5 -6.25 9 9 9\n7 8.5 10 1 1 1\n",
        "# x y z of a program\n5.279 -0.532 12.5 0 0 1\n4 5 -6.25 0 0 1\n# more\n7 8.5 10 0 0 1\n",
        "5.279,-0.532,12.5,0,0,-1\n4,5,-6.25,0,0,1\n7,8.5,10,0,1,0\n",
    ],
)
def test_the_same_three_points(tmp_path: Path, text: str) -> None:
    assert read(tmp_path, text) == POINTS


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_byte_order_marks(tmp_path: Path, encoding: str) -> None:
    assert read(tmp_path, "5.279 -0.532 12.5\n4 5 -6.25\n7 8.5 10\n", encoding) == POINTS


@pytest.mark.parametrize(
    "text, message",
    [
        # A decimal comma, or two numbers?
        ("5,279,-0,532,12,500\n4,100,5,200,6,250\n", "whose commas may separate numbers or be part of them"),
        ("1,2,3,4\n5,6,7,8\n", "whose commas may separate numbers or be part of them"),
        ("1,5,2,5,3,5,0.5\n1,5,2,5,3,5,0.5\n", "whose commas may separate numbers or be part of them"),
        # Thousands, or decimals?
        ("1,234;5,279;2,532\n4,100;5,200;6,250\n", "which may be a thousand or have a decimal comma"),
        ("1,234.5,2,001.5,3,100.5\n1,250.5,2,100.5,3,200.5\n", "whose commas may separate numbers"),
        ("1,234.5,2.5,3.5\n1,250.5,2.5,3.5\n", "whose commas may separate numbers"),
        ("1,234.5;2.5;3.5\n", "'1,234.5', whose comma is no decimal one"),
        ("1.234,5;2,5;3,5\n", "'1.234,5', whose comma is no decimal one"),
        ("1,234,567;2;3\n", "'1,234,567', whose comma is no decimal one"),
        ("1,5;2,5;3,5\n1.5,2.5,3.5\n", r"commas between numbers .* and within them"),
        ("1,234.5,2.5,3.5\n250.5,2.5,3.5\n", "rows of 3 and of 4 numbers"),
        ("1,,3,4\n", "the row '1,,3,4'"),
        ("1;;3;4\n", "could not convert"),
        ("1, 2 3\n", "the row '1, 2 3'"),
        ("1_0 2 3\n", "could not convert"),
        ("1 2\n3 4\n5 6\n", "the row '1 2'"),
        ("points of a vessel\n1 2 3\n", "could not convert|numbers"),
        ("x_m y_m z_m\n1 2 3\n", "could not convert"),
        ("5\n1 2 3\n4 5 6\n", "the row '5'"),
        ("# id x y z\n1 2 3\n4 5 6\n", r"3 numbers in a row under 4 names \(id, x, y, z\)"),
        ("x y z x\n1 2 3 4\n", "two columns of one name"),
        ("1 5.5 2 3\n2 6 2 3\n3 7 3 3\n4 8 3 3\n", "a first column that counts the rows"),
    ],
)
def test_what_could_be_read_in_two_ways_is_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError, match=rf"c\.xyz: expected rows of x y z, received .*({message})"):
        read(tmp_path, text)
