"""NRRD files: what other programs write is read, broken ones are refused by name."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from registration.errors import InputError
from registration.readers.nrrd import nrrd_bytes, read_nrrd
from registration.readers.sequence import PlusSequence

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


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("NRRD0004", "NRDD0004", "expected an NRRD file"),
        ("ultrasound image orientation:=MN\n", "", "expected the key 'ultrasound image orientation'"),
        ("unsigned char", "block", "expected a number type and encoding raw or gzip"),
        ("raw", "hex", "expected a number type and encoding raw or gzip"),
        ("raw", "gzip", "expected gzipped pixels"),
        ("4 3 2", "4 3 9", "expected 108 bytes of pixels, found 24"),
        ("4 3 2", "4 3 b", "expected whole numbers for sizes"),
        ("domain domain list", "domain domain domain", "expected two domain axes"),
    ],
)
def test_broken_files_are_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(InputError, match=rf"a\.igs\.nrrd: {message}"):
        read_nrrd(written(tmp_path, HEADER.replace(old, new)))
