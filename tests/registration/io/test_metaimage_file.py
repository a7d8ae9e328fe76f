"""MetaImage files however they store their numbers: the same values as SimpleITK's, or a refusal where it is wrong."""

from __future__ import annotations

import zlib
from pathlib import Path

import numpy as np
import pytest
import SimpleITK

from registration.errors import InputError
from registration.io.metaimage_file import read_metaimage_file

VALUES = (np.arange(60, dtype=np.int16).reshape(3, 4, 5) * 257 - 4000).astype("<i2")
RAW = VALUES.tobytes()
HEAD = (
    "ObjectType = Image\nNDims = 3\nBinaryData = True\n{}DimSize = 5 4 3\nElementType = MET_SHORT\n"
    "ElementDataFile = {}\n"
)


def write(path: Path, more: str = "", where: str = "LOCAL", data: bytes = RAW) -> Path:
    path.write_bytes(HEAD.format(more, where).encode() + data)
    return path


def simpleitk(path: Path) -> np.ndarray:
    SimpleITK.ProcessObject.SetGlobalWarningDisplay(False)
    return np.asarray(SimpleITK.GetArrayFromImage(SimpleITK.ReadImage(str(path))))


@pytest.mark.parametrize(
    ("more", "data"),
    [
        ("", RAW),
        ("BinaryDataByteOrderMSB = True\n", VALUES.astype(">i2").tobytes()),
        ("ElementByteOrderMSB = True\n", VALUES.astype(">i2").tobytes()),
        ("ElementByteOrderMSB = False\n", RAW),
        (f"CompressedData = True\nCompressedDataSize = {len(zlib.compress(RAW))}\n", zlib.compress(RAW)),
    ],
)
def test_voxels_after_the_header(tmp_path: Path, more: str, data: bytes) -> None:
    path = write(tmp_path / "a.mha", more, data=data)
    np.testing.assert_array_equal(read_metaimage_file(path).values, VALUES)
    np.testing.assert_array_equal(simpleitk(path), VALUES)


@pytest.mark.parametrize(
    ("more", "before"), [("HeaderSize = 9\n", b"123456789"), ("HeaderSize = -1\n", b"123"), ("", b"")]
)
@pytest.mark.parametrize("where", ["v.raw", "s%02d.raw 8 10 1", "LIST", "LIST 2"])
def test_voxels_in_files_of_their_own(tmp_path: Path, more: str, before: bytes, where: str) -> None:
    (tmp_path / "v.raw").write_bytes(before + RAW)
    for number, part in zip((8, 9, 10), VALUES, strict=True):
        (tmp_path / f"s{number:02d}.raw").write_bytes(before + part.tobytes())
    listed = b"s08.raw\ns09.raw\ns10.raw\n" if where.startswith("LIST") else b""
    path = write(tmp_path / "a.mhd", more, where, listed)
    np.testing.assert_array_equal(read_metaimage_file(path).values, VALUES)
    np.testing.assert_array_equal(simpleitk(path), VALUES)


@pytest.mark.parametrize("size", ["-1", "end"])
def test_header_size_counts_from_the_beginning_of_the_file(tmp_path: Path, size: str) -> None:
    bare = len(HEAD.format("HeaderSize = 999\n", "LOCAL"))
    more = f"HeaderSize = {size if size == '-1' else f'{bare + 7:03d}'}\n"
    path = write(tmp_path / "a.mha", more, data=b"1234567" + RAW)
    np.testing.assert_array_equal(read_metaimage_file(path).values, VALUES)
    np.testing.assert_array_equal(simpleitk(path), VALUES)


def test_channels(tmp_path: Path) -> None:
    colours = np.random.default_rng(0).integers(0, 999, (3, 4, 5, 3)).astype("<i2")
    path = write(tmp_path / "a.mha", "ElementNumberOfChannels = 3\n", data=colours.tobytes())
    np.testing.assert_array_equal(read_metaimage_file(path).values, colours)
    np.testing.assert_array_equal(simpleitk(path), colours)
    path.write_bytes(path.read_bytes().replace(b"MET_SHORT", b"MET_SHORT_ARRAY"))
    np.testing.assert_array_equal(read_metaimage_file(path).values, colours)


def test_what_simpleitk_takes_for_other_numbers(tmp_path: Path) -> None:
    packed = zlib.compress(RAW)
    # Without the packed size it reads nothing and hands out whatever is there.
    path = write(tmp_path / "a.mha", "CompressedData = True\n", data=packed)
    np.testing.assert_array_equal(read_metaimage_file(path).values, VALUES)
    text = write(
        tmp_path / "t.mha", "BinaryData = False\n", data=" ".join(map(str, VALUES.reshape(-1))).encode()
    )
    np.testing.assert_array_equal(read_metaimage_file(text).values, VALUES)


@pytest.mark.parametrize(
    ("more", "where", "data", "message"),
    [
        ("", "LOCAL", RAW[:-1], "expected 120 bytes of pixels, found 119"),
        (
            "CompressedData = True\n",
            "LOCAL",
            zlib.compress(RAW)[:-2],
            "zlib-compressed pixels with their end",
        ),
        ("CompressedData = True\n", "LOCAL", zlib.compress(RAW)[:-4] + b"1234", "found broken data"),
        (
            "CompressedData = True\nHeaderSize = -1\n",
            "LOCAL",
            zlib.compress(RAW),
            "expected a HeaderSize of 0",
        ),
        ("HeaderSize = -3\n", "LOCAL", RAW, "expected a HeaderSize of 0 or more, or -1"),
        ("HeaderSize = big\n", "LOCAL", RAW, "expected a whole number in HeaderSize, found 'big'"),
        (
            "ElementNumberOfChannels = two\n",
            "LOCAL",
            RAW,
            "expected a whole number in ElementNumberOfChannels",
        ),
        ("", "LIST", b"a.raw\nb.raw\n", r"expected its voxels in .*a\.raw, received nothing there"),
        ("", "LIST", b"", "expected 60 numbers in equal parts, found 0 data files"),
        ("", "s%d.raw 3 1 1", b"", "expected a pattern with one number"),
    ],
)
def test_what_is_not_all_there_is_refused(
    tmp_path: Path, more: str, where: str, data: bytes, message: str
) -> None:
    with pytest.raises(InputError, match=rf"a\.mhd: .*{message}") as refusal:
        read_metaimage_file(write(tmp_path / "a.mhd", more, where, data))
    assert "\n" not in str(refusal.value)
