"""Files held against what their headers promise."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from registration.errors import InputError
from registration.file_checks import require_complete

PLY = "ply\r\nformat ascii 1.0\r\nelement vertex 2\r\nproperty float x\r\nproperty double y\r\n{more}end_header\r\n"


def test_a_ply_of_text_needs_its_numbers(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    path.write_text(PLY.format(more="") + "1 2\r\n3 4\r\n")
    require_complete(path)
    path.write_text(PLY.format(more="") + "1 2\r\n3\r\n")
    with pytest.raises(
        InputError, match=r"a\.ply: expected 4 numbers after the header, received 3: cut short"
    ):
        require_complete(path)


def test_a_binary_ply_needs_its_bytes_faces_included(tmp_path: Path) -> None:
    path = tmp_path / "b.ply"
    faces = "element face 1\nproperty list uchar int vertex_indices\n"
    head = PLY.format(more=faces).replace("ascii", "binary_little_endian").replace("\r", "").encode()
    body = struct.pack("<fdfd", 1, 2, 3, 4) + struct.pack("<Biii", 3, 0, 1, 0)
    path.write_bytes(head + body)
    require_complete(path)
    path.write_bytes(head + body[:-1])
    with pytest.raises(
        InputError, match=r"b\.ply: expected 37 bytes after the header, received 36: cut short"
    ):
        require_complete(path)


def test_a_binary_ply_may_begin_with_a_line_break_in_its_numbers(tmp_path: Path) -> None:
    head = PLY.format(more="").replace("ascii", "binary_little_endian").replace("\r", "").encode()
    (tmp_path / "n.ply").write_bytes(head + b"\n" + b"\n" * 23)
    require_complete(tmp_path / "n.ply")


def test_an_stl_is_as_long_as_its_count_says(tmp_path: Path) -> None:
    path = tmp_path / "m.stl"
    path.write_bytes(b"solid in name only".ljust(80) + struct.pack("<I", 2) + bytes(100))
    require_complete(path)
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(
        InputError, match=r"m\.stl: expected an STL file of 84 \+ 50 bytes a triangle, received 183"
    ):
        require_complete(path)


def test_an_stl_of_text_ends_as_such(tmp_path: Path) -> None:
    path = tmp_path / "t.stl"
    path.write_text("solid t\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\n")
    with pytest.raises(InputError, match=r"t\.stl: expected endsolid"):
        require_complete(path)


def test_a_pcd_of_text_needs_its_numbers(tmp_path: Path) -> None:
    path = tmp_path / "c.pcd"
    head = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA ascii\n"
    path.write_text(head + "1 2 3\n4 5 6\n")
    require_complete(path)
    path.write_text(head + "1 2 3\n4 5\n")
    with pytest.raises(InputError, match=r"c\.pcd: expected 6 numbers after the header, received 5"):
        require_complete(path)


def test_an_unknown_type_in_a_header_names_the_file(tmp_path: Path) -> None:
    (tmp_path / "u.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty half x\nend_header\n1\n"
    )
    with pytest.raises(InputError, match=r"u\.ply: expected a header that can be read"):
        require_complete(tmp_path / "u.ply")


def test_other_kinds_pass_unread(tmp_path: Path) -> None:
    require_complete(tmp_path / "not-there.vtp")
