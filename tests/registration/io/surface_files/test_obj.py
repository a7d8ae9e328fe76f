"""OBJ: indices of both directions, polygons, and lines that are neither."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from registration.errors import InputError
from registration.io.surface_files.obj import read_obj

VERTICES = "v 0 0 1\nv 4 0 1 0.5 0.5 0.5\nv 4 3 1 1.0\nv 0 3 1\n"


@pytest.mark.parametrize(
    "faces, expected",
    [
        ("f 1 2 3 4\n", [[0, 1, 2, 3]]),
        ("f -4 -3 -2\nf -2 -1 -4\n", [[0, 1, 2], [2, 3, 0]]),
        ("vt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1\nf 3//1 4//1 1//1\n", [[0, 1, 2], [2, 3, 0]]),
        ("g a\nusemtl b\nl 1 2\nf 1 2 3 # note\nf 3 4 \\\n1\n", [[0, 1, 2], [2, 3, 0]]),
    ],
)
def test_faces(tmp_path: Path, faces: str, expected: list[list[int]]) -> None:
    (tmp_path / "m.obj").write_text("\ufeff# made by hand\n" + VERTICES + faces)
    found = read_obj(tmp_path / "m.obj")
    np.testing.assert_array_equal(found.points, [[0, 0, 1], [4, 0, 1], [4, 3, 1], [0, 3, 1]])
    assert [part.tolist() for part in np.split(found.corners, found.offsets[1:-1])] == expected


def test_negative_indices_count_from_the_face(tmp_path: Path) -> None:
    (tmp_path / "m.obj").write_text(VERTICES + "f -4 -3 -2\nv 9 9 9\nf -5 -4 -1\n")
    assert read_obj(tmp_path / "m.obj").corners.tolist() == [0, 1, 2, 0, 1, 4]


@pytest.mark.parametrize("faces", ["f 1 2 5\n", "f 1 2 -5\n", "f 1 2 3 9\n"])
def test_indices_of_no_vertex_are_refused(tmp_path: Path, faces: str) -> None:
    (tmp_path / "m.obj").write_text(VERTICES + faces)
    with pytest.raises(InputError, match="triangles: expected indices from 0 to 3"):
        read_obj(tmp_path / "m.obj").triangles()


@pytest.mark.parametrize(
    "text, message",
    [
        (VERTICES + "f 1 2", "expected three entries in line 5, received 2: cut short"),
        ("v 0 0", "expected three entries in line 1, received 2: cut short"),
        (VERTICES + "f 0 1 2", "expected numbers in line 5, received index 0"),
        (VERTICES + "f 1 2 x", "expected numbers in line 5"),
        ("v 0,5 0 1\n", "expected numbers in line 1"),
    ],
)
def test_broken_lines_are_named(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "m.obj").write_text(text)
    with pytest.raises(InputError, match=rf"m\.obj: {message}"):
        read_obj(tmp_path / "m.obj")
