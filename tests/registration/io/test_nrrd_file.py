"""NRRD files however they store their numbers: the same values as SimpleITK's, or a refusal where it is silent."""

from __future__ import annotations

import bz2
import gzip
from pathlib import Path

import numpy as np
import pytest
import SimpleITK

from registration.errors import InputError
from registration.io.nrrd_file import nrrd_header, read_nrrd_file

VALUES = (np.arange(60, dtype=np.int16).reshape(3, 4, 5) * 257 - 4000).astype("<i2")
RAW = VALUES.tobytes()
HEAD = "NRRD0004\n# by hand\ntype: short\ndimension: 3\nsizes: 5 4 3\nendian: little\nencoding: {}\n{}\n"
PACKED = {
    "raw": RAW,
    "gz": gzip.compress(RAW),
    "gzip": gzip.compress(RAW[:40]) + gzip.compress(RAW[40:]),
    "bzip2": bz2.compress(RAW),
    "bz2": bz2.compress(RAW),
    "ascii": " ".join(map(str, VALUES.reshape(-1))).encode(),
    "text": "\n".join(map(str, VALUES.reshape(-1))).encode(),
    "hex": RAW.hex().encode(),
}


def write(path: Path, encoding: str = "raw", more: str = "", data: bytes = RAW) -> Path:
    path.write_bytes(HEAD.format(encoding, more).encode() + data)
    return path


def simpleitk(path: Path) -> np.ndarray:
    SimpleITK.ProcessObject.SetGlobalWarningDisplay(False)
    return np.asarray(SimpleITK.GetArrayFromImage(SimpleITK.ReadImage(str(path))))


@pytest.mark.parametrize("encoding", PACKED)
def test_every_encoding(tmp_path: Path, encoding: str) -> None:
    path = write(tmp_path / "a.nrrd", encoding, data=PACKED[encoding])
    np.testing.assert_array_equal(read_nrrd_file(path).values, VALUES)
    # NrrdIO has no bzip2, and reads one gzip stream of several.
    if encoding not in ("bzip2", "bz2", "gzip"):
        np.testing.assert_array_equal(simpleitk(path), VALUES)


@pytest.mark.parametrize(
    ("encoding", "more", "before"),
    [
        ("raw", "byte skip: 7\n", b"1234567"),
        ("raw", "byteskip: -1\n", b"a header of another program\n\n"),
        ("raw", "line skip: 2\n", b"first\nsecond\n"),
        ("raw", "line skip: 1\nbyte skip: 3\n", b"first\n123"),
        ("ascii", "lineskip: 1\n", b"not 1 2 3 numbers\n"),
    ],
)
def test_skips(tmp_path: Path, encoding: str, more: str, before: bytes) -> None:
    path = write(tmp_path / "a.nrrd", encoding, more, before + PACKED[encoding])
    np.testing.assert_array_equal(read_nrrd_file(path).values, VALUES)
    np.testing.assert_array_equal(simpleitk(path), VALUES)


def test_lines_are_skipped_before_unpacking_and_bytes_after_it(tmp_path: Path) -> None:
    more = "line skip: 1\nbyte skip: 4\n"
    path = write(tmp_path / "a.nrrd", "gzip", more, b"first\n" + gzip.compress(b"1234" + RAW))
    np.testing.assert_array_equal(read_nrrd_file(path).values, VALUES)


@pytest.mark.parametrize(
    "where", ["s%03d.raw 8 10 1", "s%03d.raw 8 10 1 2", "LIST\ns008.raw\ns009.raw\ns010.raw", "all.raw"]
)
@pytest.mark.parametrize("name", ["a.nhdr", "A.NHDR"])
def test_numbers_in_files_of_their_own(tmp_path: Path, where: str, name: str) -> None:
    for number, part in zip((8, 9, 10), VALUES, strict=True):
        (tmp_path / f"s{number:03d}.raw").write_bytes(part.tobytes())
    (tmp_path / "all.raw").write_bytes(RAW)
    path = write(tmp_path / name, more=f"data file: {where}\n", data=b"")
    # SimpleITK takes an empty line after a list for a file's name.
    path.write_bytes(path.read_bytes().rstrip() + (b"\n" if where.startswith("LIST") else b"\n\n"))
    np.testing.assert_array_equal(read_nrrd_file(path).values, VALUES)
    if name == "a.nhdr":
        np.testing.assert_array_equal(simpleitk(path), VALUES)


def test_a_skip_counts_in_every_file(tmp_path: Path) -> None:
    for number, part in enumerate(VALUES):
        (tmp_path / f"s{number}.raw").write_bytes(b"head" + part.tobytes())
    path = write(tmp_path / "a.nhdr", more="byte skip: -1\ndatafile: s%d.raw 0 2 1\n", data=b"")
    np.testing.assert_array_equal(read_nrrd_file(path).values, VALUES)


def test_big_end_first_and_sixty_four_bits(tmp_path: Path) -> None:
    path = write(tmp_path / "a.nrrd", data=VALUES.astype(">i8").tobytes())
    content = path.read_bytes().replace(b"type: short", b"type: long long int").replace(b"little", b"big")
    path.write_bytes(content)
    np.testing.assert_array_equal(read_nrrd_file(path).values, VALUES)


def test_keys_are_no_fields_and_keep_their_escapes(tmp_path: Path) -> None:
    path = write(tmp_path / "a.nrrd", more="sizes:=1 1 1\nnote:=two\\nlines, C:\\\\new\n")
    file = read_nrrd_file(path)
    assert file.sizes == (5, 4, 3)
    assert file.keys == {"sizes": "1 1 1", "note": "two\nlines, C:\\new"}
    (tmp_path / "b.nrrd").write_bytes(nrrd_header(file.fields, file.keys, "raw") + RAW)
    again = read_nrrd_file(tmp_path / "b.nrrd")
    assert (again.keys, again.sizes) == (file.keys, file.sizes)
    np.testing.assert_array_equal(again.values, VALUES)


@pytest.mark.parametrize(
    ("encoding", "more", "data", "message"),
    [
        ("raw", "", RAW[:-1], "expected 120 bytes of pixels, found 119"),
        ("raw", "byte skip: 1\n", RAW, "expected 120 bytes of pixels, found 119"),
        ("raw", "byte skip: -1\n", RAW[:-3], "expected 120 bytes of pixels, found 117"),
        ("raw", "byte skip: -2\n", RAW, "expected a line skip of 0 or more and a byte skip"),
        ("gzip", "byte skip: -1\n", PACKED["gz"], "expected a line skip of 0 or more and a byte skip"),
        ("raw", "byte skip: x\n", RAW, "expected a whole number in byte skip, found 'x'"),
        ("raw", "line skip: 400\n", RAW, "expected 400 lines to skip, found fewer"),
        ("gzip", "", PACKED["gz"][:-5], "expected gzipped pixels with their end"),
        ("gzip", "", PACKED["gz"][:-8] + b"12345678", "expected gzipped pixels, found broken data"),
        ("bzip2", "", PACKED["bz2"][:-5], "expected bzip2-compressed pixels with their end"),
        ("ascii", "", PACKED["ascii"][:-20], "expected 60 pixels as text, found 5"),
        ("ascii", "", PACKED["ascii"].replace(b"-4000", b"many"), "expected pixels of type i2 as text"),
        ("ascii", "", PACKED["ascii"].replace(b"-4000", b"40000"), "expected pixels of type i2 as text"),
        ("hex", "", b"xy" * 120, "expected hexadecimal digits"),
        ("raw", "data file: none.raw\n", b"", "expected its voxels in .*none.raw, received nothing there"),
        ("raw", "data file: s%d.raw 1 x\n", b"", "expected first, last and step of the numbers in s%d.raw"),
        ("raw", "data file: s%s.raw 1 2 1\n", b"", "expected a pattern with one number"),
        ("raw", "data file: s%d.raw 1 7 1\n", b"", "expected 60 numbers in equal parts, found 7 data files"),
    ],
)
def test_what_is_not_all_there_is_refused(
    tmp_path: Path, encoding: str, more: str, data: bytes, message: str
) -> None:
    with pytest.raises(InputError, match=rf"a\.nrrd: .*{message}") as refusal:
        read_nrrd_file(write(tmp_path / "a.nrrd", encoding, more, data))
    assert "\n" not in str(refusal.value)
