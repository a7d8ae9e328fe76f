"""PCD with numbers of any size, as text, binary and compressed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import open3d
import pytest

from registration.errors import InputError
from registration.io.surface_files.pcd import read_pcd

POINTS = np.random.default_rng(8).normal(0, 30, (40, 3))
HEAD = """# .PCD v0.7
VERSION 0.7
FIELDS intensity x y _ z
SIZE 4 {size} {size} 1 {size}
TYPE F F F U F
COUNT 1 1 1 3 1
WIDTH 40
HEIGHT 1
VIEWPOINT 0 0 0 1 0 0 0
POINTS 40
DATA {kind}
"""


def table(size: int) -> np.ndarray:
    number = f"<f{size}"
    rows = np.zeros(40, [("i", "<f4"), ("x", number), ("y", number), ("p", "u1", 3), ("z", number)])
    for axis in range(3):
        rows["xyz"[axis]] = POINTS[:, axis]
    rows["i"] = 7
    return rows


def literal(data: bytes) -> bytes:
    """LZF without any copies."""
    runs = [data[at : at + 32] for at in range(0, len(data), 32)]
    return b"".join(bytes([len(run) - 1]) + run for run in runs)


def content(kind: str, size: int) -> bytes:
    head, rows = HEAD.format(kind=kind, size=size).encode(), table(size)
    if kind == "ascii":
        lines = [f"7 {float(row['x'])!r} {float(row['y'])!r} 0 0 0 {float(row['z'])!r}" for row in rows]
        return head + "\n".join(lines).encode() + b"\n"
    if kind == "binary":
        return head + rows.tobytes()
    loose = b"".join(np.ascontiguousarray(rows[name]).tobytes() for name in rows.dtype.names)
    packed = literal(loose)
    return head + np.array([len(packed), len(loose)], "<u4").tobytes() + packed


@pytest.mark.parametrize("kind", ["ascii", "binary", "binary_compressed"])
@pytest.mark.parametrize("size", [4, 8])
def test_numbers_of_both_sizes_between_other_fields(tmp_path: Path, kind: str, size: int) -> None:
    (tmp_path / "c.pcd").write_bytes(content(kind, size))
    found = read_pcd(tmp_path / "c.pcd").points
    np.testing.assert_allclose(found, POINTS, rtol=0, atol=1e-5 if size == 4 else 1e-12)


def test_copies_of_a_compressed_file_are_followed(tmp_path: Path) -> None:
    """A regular grid, which Open3D packs with copies that reach into themselves."""
    grid = np.stack(np.meshgrid(np.arange(9.0), np.arange(7.0), [5.0]), axis=-1).reshape(-1, 3)
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(grid))
    open3d.io.write_point_cloud(str(tmp_path / "c.pcd"), cloud, compressed=True)
    assert (tmp_path / "c.pcd").stat().st_size < grid.size * 4
    np.testing.assert_array_equal(read_pcd(tmp_path / "c.pcd").points, grid)


@pytest.mark.parametrize("kind", ["ascii", "binary", "binary_compressed"])
@pytest.mark.parametrize("share", [0.3, 0.6, 0.97])
def test_files_cut_short_are_refused(tmp_path: Path, kind: str, share: float) -> None:
    whole = content(kind, 8)
    (tmp_path / "c.pcd").write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(InputError, match=r"c\.pcd: expected .* cut short"):
        read_pcd(tmp_path / "c.pcd")


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("FIELDS intensity x", "FIELDS intensity u", "expected a header that can be read"),
        ("TYPE F", "TYPE Q", "expected a header that can be read"),
        ("SIZE 4", "SIZE 3", "expected a header that can be read"),
        ("SIZE 4 ", "SIZE ", "expected a header that can be read"),
        ("DATA binary", "DATA other", "expected a header that can be read"),
        ("DATA", "BODY", "expected a header that ends in DATA"),
    ],
)
def test_headers_that_say_something_else_are_refused(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    (tmp_path / "c.pcd").write_bytes(content("binary", 8).replace(old.encode(), new.encode(), 1))
    with pytest.raises(InputError, match=rf"c\.pcd: {message}"):
        read_pcd(tmp_path / "c.pcd")
