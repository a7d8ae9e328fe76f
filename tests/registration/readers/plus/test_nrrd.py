"""NRRD files: what other programs write is read, broken ones are refused by name."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from registration.errors import InputError
from registration.readers.plus.nrrd import nrrd_bytes, read_nrrd
from registration.readers.plus.sequence import PlusSequence

PIXELS = np.arange(24, dtype=np.uint8).reshape(2, 3, 4)
HEADER = (
    "NRRD0004\n# by hand\ntype: unsigned char\ndimension: 3\nsizes: 4 3 2\nkinds: domain domain list\n"
    "encoding: raw\nultrasound image orientation:=MN\nSeq_Frame0000_Status:=OK\nSeq_Frame0001_Timestamp:=2.5\n\n"
)


def written(tmp_path: Path, header: str = HEADER, data: bytes = PIXELS.tobytes()) -> Path:
    path = tmp_path / "a.igs.nrrd"
    path.write_bytes(header.encode() + data)
    return path


def test_hand_written_header(tmp_path: Path) -> None:
    sequence = read_nrrd(written(tmp_path))
    np.testing.assert_array_equal(sequence.pixels, PIXELS[:, ::-1])
    assert sequence.frame_fields == ({"ImageStatus": "OK"}, {"Timestamp": "2.5"})


def test_pixel_data_may_hold_empty_lines(tmp_path: Path) -> None:
    data = b"\r\n\n\n\r\n\r\n" * 3
    assert read_nrrd(written(tmp_path, data=data), "MF").pixels.tobytes() == data


def test_header_with_carriage_returns(tmp_path: Path) -> None:
    sequence = read_nrrd(written(tmp_path, HEADER.replace("\n", "\r\n")))
    np.testing.assert_array_equal(sequence.pixels, PIXELS[:, ::-1])


def test_big_endian_gzip(tmp_path: Path) -> None:
    header = HEADER.replace("unsigned char", "int16").replace("raw", "gz\nendian: big")
    sequence = read_nrrd(
        written(tmp_path, header, gzip.compress((PIXELS.astype(np.int16) * 256).astype(">i2").tobytes())),
        "MF",
    )
    np.testing.assert_array_equal(sequence.pixels, PIXELS.astype(np.int16) * 256)


def test_colour_comes_back(tmp_path: Path) -> None:
    pixels = np.random.default_rng(0).integers(0, 256, (2, 3, 4, 3)).astype(np.uint8)
    path = tmp_path / "b.igs.nrrd"
    path.write_bytes(nrrd_bytes(PlusSequence(pixels, ({}, {})), compressed=True))
    np.testing.assert_array_equal(read_nrrd(path).pixels, pixels)


RGB = np.random.default_rng(0).integers(0, 256, (2, 3, 4, 3)).astype(np.uint8)
# What each axis of a header may be, and PIXELS or RGB (frame, row, column, colour) with their axes in that order.
LAYOUTS = {
    "domain domain list": PIXELS,
    "list domain domain": PIXELS.transpose(1, 2, 0),
    "domain list domain": PIXELS.transpose(1, 0, 2),
    "space space time": PIXELS,
    "list domain domain domain": PIXELS.transpose(1, 2, 0)[None],
    "domain domain domain list": PIXELS[:, None],
    "stub domain domain list": PIXELS[..., None],
    "RGB-color domain domain list": RGB,
    "vector domain domain list": RGB,
    "3-color domain domain list": RGB,
    "domain domain list RGB-color": np.moveaxis(RGB, 3, 0),
    "domain domain RGB-color list": np.moveaxis(RGB, 3, 1),
    "list RGB-color domain domain": RGB.transpose(1, 2, 3, 0),
    "RGB-color list domain domain": RGB.transpose(1, 2, 0, 3),
}


@pytest.mark.parametrize("kinds", LAYOUTS)
def test_the_order_of_axes_is_the_headers(tmp_path: Path, kinds: str) -> None:
    stored = LAYOUTS[kinds]
    header = HEADER.replace("dimension: 3", f"dimension: {stored.ndim}")
    header = header.replace("4 3 2", " ".join(map(str, stored.shape[::-1]))).replace(
        "domain domain list", kinds
    )
    sequence = read_nrrd(written(tmp_path, header, stored.tobytes()), "MF")
    coloured = {"vector", "RGB-color", "3-color"} & set(kinds.split())
    np.testing.assert_array_equal(sequence.pixels, RGB if coloured else PIXELS)
    assert sequence.frame_fields == ({"ImageStatus": "OK"}, {"Timestamp": "2.5"})


def test_axes_of_unknown_kind_are_told_by_their_directions(tmp_path: Path) -> None:
    directions = "space dimension: 2\nspace directions: none (1,0) (0,1)\nkinds: list ??? none\n"
    header = HEADER.replace("4 3 2", "2 4 3").replace("kinds: domain domain list\n", directions)
    sequence = read_nrrd(written(tmp_path, header, PIXELS.transpose(1, 2, 0).tobytes()), "MF")
    np.testing.assert_array_equal(sequence.pixels, PIXELS)
    # Two frames or two channels: without a kind, nobody knows.
    with pytest.raises(InputError, match="expected two domain axes"):
        read_nrrd(written(tmp_path, header.replace("list ???", "??? ???")), "MF")


def test_one_image_without_kinds(tmp_path: Path) -> None:
    header = (
        HEADER.replace("4 3 2", "4 6")
        .replace("dimension: 3", "dimension: 2")
        .replace("kinds: domain domain list\n", "")
    )
    sequence = read_nrrd(written(tmp_path, header), "MF")
    np.testing.assert_array_equal(sequence.pixels, PIXELS.reshape(1, 6, 4))


def test_a_placeholder_of_one_pixel_is_no_image_whatever_its_orientation(tmp_path: Path) -> None:
    for name, header in (("a", HEADER), ("b", HEADER.replace("ultrasound image orientation:=MN\n", ""))):
        path = tmp_path / f"{name}.igs.nrrd"
        path.write_bytes(header.replace("4 3 2", "1 1 2").encode() + b"00")
        sequence = read_nrrd(path)
        assert sequence.tracker_only
        assert len(sequence.frame_fields) == 2


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("NRRD0004", "NRDD0004", "expected an NRRD file"),
        ("ultrasound image orientation:=MN\n", "", "expected the key 'ultrasound image orientation'"),
        ("unsigned char", "block", "expected a number type and encoding raw, gzip"),
        ("raw", "rle", "expected a number type and encoding raw, gzip"),
        ("raw", "gzip", "expected gzipped pixels"),
        ("4 3 2", "4 3 9", "expected 108 bytes of pixels, found 24"),
        ("4 3 2", "4 3 b", "expected whole numbers for sizes"),
        ("domain domain list", "domain domain domain", "expected two domain axes"),
        ("domain domain list", "domain domain", "expected two domain axes"),
        ("domain domain list", "list domain list", "expected two domain axes"),
        ("domain domain list", "HSV-color domain domain", "expected two domain axes"),
        ("kinds: domain domain list\n", "", "expected two domain axes"),
    ],
)
def test_broken_files_are_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(InputError, match=rf"a\.igs\.nrrd: {message}"):
        read_nrrd(written(tmp_path, HEADER.replace(old, new)))
