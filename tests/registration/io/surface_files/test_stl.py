"""STL of every kind that programs write."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from registration.errors import InputError
from registration.io.surface_files.stl import is_text, read_stl

CORNERS = np.array([[[0, 0, 5], [3, 0, 5], [0, 4, 5]], [[3, 0, 5], [3, 4, 5], [0, 4, 5]]], dtype=np.float32)


def binary(corners: np.ndarray = CORNERS, header: bytes = b"", attribute: int = 0) -> bytes:
    rows = [struct.pack("<12fH", 0, 0, 1, *corner.ravel(), attribute) for corner in corners]
    return header.ljust(80) + struct.pack("<I", len(corners)) + b"".join(rows)


def text(name: str = "t", corners: np.ndarray = CORNERS) -> str:
    facets = [
        "facet normal 0 0 1\n outer loop\n"
        + "".join(f"  vertex {x} {y} {z}\n" for x, y, z in corner)
        + " endloop\nendfacet\n"
        for corner in corners
    ]
    return f"solid {name}\n" + "".join(facets) + f"endsolid {name}\n"


def read(path: Path, content: bytes | str) -> np.ndarray:
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    found = read_stl(path)
    assert len(np.unique(found.points, axis=0)) == len(found.points)
    return found.points[found.triangles()]


@pytest.mark.parametrize(
    "content",
    [
        text(),
        " " + text(),
        "\n\t" + text(),
        "\ufeff" + text(),
        text().upper(),
        text().replace("solid", "Solid").replace("\n", "\r\n"),
        text("a vertex of 1 2 3"),
        text("one", CORNERS[:1]) + "\n" + text("two", CORNERS[1:]),
        text().replace("solid t\n", "solid\n"),
        text().replace(".0", ".0e+00"),
        binary(),
        binary(header=b"solid exported by a program"),
        binary(header=b"solid facet\nfacet normal", attribute=0x7C1F),
        binary(header=b"COLOR=\xff\x00\x00\xff", attribute=65535),
        binary() + b"\0",
        binary() + b"trailing notes of a program",
        binary(header=b"solid") + bytes(100),
        binary() + bytes(range(1, 201)),
    ],
)
def test_the_same_two_triangles(tmp_path: Path, content: bytes | str) -> None:
    np.testing.assert_allclose(read(tmp_path / "m.stl", content), CORNERS)


@pytest.mark.parametrize(
    "content, message",
    [
        (binary()[:-1], r"expected an STL file of 84 \+ 50 bytes a triangle, received 183 bytes \(cut short"),
        (binary(header=b"solid")[:120], r"expected an STL file of 84 \+ 50 bytes a triangle, received 120"),
        (b"", "received 0 bytes"),
        (b"rubbish", "received 7 bytes"),
        (text()[:-12], "expected endsolid at the end, received an STL file that was cut short"),
        (text()[: len(text()) // 2], "expected endsolid"),
        (
            text().replace("  vertex 3 0 5\n", "", 1).replace("  vertex 3.0 0.0 5.0\n", "", 1),
            "expected endsolid",
        ),
        (text().replace("3.0", "3,5"), "expected three numbers a vertex"),
        (
            binary()[:80] + struct.pack("<I", 1) + binary()[84:],
            "received 1 triangles more than the 1 it counts",
        ),
        (
            binary()[:80] + struct.pack("<I", 0) + binary()[84:],
            "received 2 triangles more than the 0 it counts",
        ),
    ],
)
def test_what_is_cut_short_or_miscounted_is_refused(
    tmp_path: Path, content: bytes | str, message: str
) -> None:
    with pytest.raises(InputError, match=rf"m\.stl: .*{message}"):
        read(tmp_path / "m.stl", content)


def test_text_is_told_from_binary() -> None:
    assert is_text(b"  SOLID x\nfacet")
    assert not is_text(binary(header=b"solid x"))
