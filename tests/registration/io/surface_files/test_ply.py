"""PLY of both byte orders, with polygons, and held against what the header promises."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from registration.errors import InputError
from registration.io.surface_files.ply import read_ply

HEAD = (
    "ply\nformat {form} 1.0\ncomment of a program\nelement vertex 5\nproperty double x\nproperty uchar red\n"
)
HEAD += "property double y\nproperty double z\n{more}end_header\n"
FACES = "element face {count}\nproperty uchar flags\nproperty list uchar int {name}\nproperty float quality\n"
POINTS = np.array([[0.1, 0, 1], [4, 0, 1], [4, 4, 1], [0, 4, 1], [1, 1, 1]])
POLYGONS = [[0, 1, 2, 3], [0, 1, 4], [1, 2, 3, 4, 0]]


def binary(order: str, faces: list[list[int]], name: str = "vertex_indices") -> bytes:
    form = "binary_little_endian" if order == "<" else "binary_big_endian"
    head = HEAD.format(form=form, more=FACES.format(count=len(faces), name=name)).encode()
    rows = [struct.pack(f"{order}dBdd", x, 200, y, z) for x, y, z in POINTS]
    rows += [struct.pack(f"{order}BB{len(face)}if", 1, len(face), *face, 0.5) for face in faces]
    return head + b"".join(rows)


def text(faces: list[list[int]]) -> bytes:
    head = HEAD.format(form="ascii", more=FACES.format(count=len(faces), name="vertex_index"))
    rows = [f"{x} 200 {y} {z}" for x, y, z in POINTS]
    rows += [f"1 {len(face)} {' '.join(map(str, face))} 0.5" for face in faces]
    return (head + "\n".join(rows) + "\n").encode()


@pytest.mark.parametrize("write", [text, lambda faces: binary("<", faces), lambda faces: binary(">", faces)])
@pytest.mark.parametrize("faces", [POLYGONS, [[0, 1, 2], [2, 3, 0]], [[0, 1, 2, 3], [3, 2, 1, 0]], []])
def test_points_and_polygons(tmp_path: Path, write, faces: list[list[int]]) -> None:
    (tmp_path / "m.ply").write_bytes(write(faces))
    found = read_ply(tmp_path / "m.ply")
    np.testing.assert_array_equal(found.points, POINTS)
    parts = np.split(found.corners, found.offsets[1:-1]) if faces else []
    assert [part.tolist() for part in parts] == faces
    assert len(found.triangles()) == sum(len(face) - 2 for face in faces)


@pytest.mark.parametrize("content", [text(POLYGONS), binary("<", POLYGONS), binary(">", POLYGONS)])
@pytest.mark.parametrize("lost", [1, 5, 12, 30])
def test_files_cut_short_are_refused(tmp_path: Path, content: bytes, lost: int) -> None:
    end = (
        content.rstrip().rfind(b" ")
        if content.startswith(b"ply\nformat ascii") and lost == 1
        else len(content) - lost
    )
    (tmp_path / "m.ply").write_bytes(content[:end])
    with pytest.raises(InputError, match=r"m\.ply: expected .*cut short"):
        read_ply(tmp_path / "m.ply").triangles()


@pytest.mark.parametrize("wrong", [[0, 1, 7], [0, 1, -1], [0, 1, 2, 5]])
def test_corners_that_are_no_vertices_are_refused(tmp_path: Path, wrong: list[int]) -> None:
    for content in (text([wrong]), binary("<", [wrong])):
        (tmp_path / "m.ply").write_bytes(content)
        with pytest.raises(InputError, match="triangles: expected indices from 0 to 4"):
            read_ply(tmp_path / "m.ply").triangles()


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("uchar red", "half red", r"u\.ply: expected a header that can be read"),
        ("element vertex 5", "element vertex -5", r"u\.ply: expected a header that can be read"),
        ("double y", "double u", r"u\.ply: expected a header that can be read"),
        ("format ascii", "format other", r"u\.ply: expected a header that can be read"),
        ("end_header", "header", r"u\.ply: expected a header that ends in end_header"),
        ("element face", "element tristrips", r"u\.ply: expected faces, received triangle strips"),
    ],
)
def test_headers_that_say_something_else_are_refused(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    (tmp_path / "u.ply").write_bytes(text(POLYGONS).replace(old.encode(), new.encode()))
    with pytest.raises(InputError, match=message):
        read_ply(tmp_path / "u.ply")


def test_line_ends_of_windows_and_numbers_that_look_like_them(tmp_path: Path) -> None:
    (tmp_path / "w.ply").write_bytes(text(POLYGONS).replace(b"\n", b"\r\n"))
    np.testing.assert_array_equal(read_ply(tmp_path / "w.ply").points, POINTS)
    head = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\n"
    head += b"property float x\nproperty float y\nproperty float z\n"
    (tmp_path / "n.ply").write_bytes(head + b"end_header\n" + b"\n" * 12)
    assert read_ply(tmp_path / "n.ply").points.shape == (1, 3)
