"""MetaImage files: what other programs write is read, broken ones are refused by name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from registration.errors import InputError
from registration.readers.plus.metaimage import metaimage_bytes, read_metaimage
from registration.readers.plus.sequence import PlusSequence

PIXELS = np.arange(24, dtype=np.uint8).reshape(2, 3, 4)
HEADER = (
    "ObjectType = Image\nNDims = 3\nDimSize = 4 3 2\nElementType = MET_UCHAR\n"
    "UltrasoundImageOrientation = UF\nSeq_Frame0001_Timestamp = 2.5\nElementDataFile = LOCAL\n"
)


def written(tmp_path: Path, header: str = HEADER, data: bytes = PIXELS.tobytes()) -> Path:
    path = tmp_path / "a.igs.mha"
    path.write_bytes(header.encode() + data)
    return path


def test_hand_written_header(tmp_path: Path) -> None:
    sequence = read_metaimage(written(tmp_path))
    np.testing.assert_array_equal(sequence.pixels, PIXELS[:, :, ::-1])
    assert sequence.frame_fields == ({}, {"Timestamp": "2.5"})


def test_given_orientation_overrules_the_file(tmp_path: Path) -> None:
    np.testing.assert_array_equal(read_metaimage(written(tmp_path), "MF").pixels, PIXELS)


def test_big_endian_words_and_a_data_file_beside(tmp_path: Path) -> None:
    header = HEADER.replace("MET_UCHAR", "MET_SHORT\nBinaryDataByteOrderMSB = True").replace("LOCAL", "a.raw")
    (tmp_path / "a.raw").write_bytes((PIXELS.astype(np.int16) * 256).astype(">i2").tobytes())
    sequence = read_metaimage(written(tmp_path, header.replace("UF", "MF"), b""))
    np.testing.assert_array_equal(sequence.pixels, PIXELS.astype(np.int16) * 256)


@pytest.mark.parametrize("kind", [np.uint8, np.int16, np.uint16, np.float32, np.float64])
def test_every_number_type_comes_back(tmp_path: Path, kind: type) -> None:
    pixels = (PIXELS.astype(kind) * 3).astype(kind)
    path = tmp_path / "b.igs.mha"
    path.write_bytes(metaimage_bytes(PlusSequence(pixels, ({}, {})), compressed=True))
    found = read_metaimage(path).pixels
    assert found.dtype == kind
    np.testing.assert_array_equal(found, pixels)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("UltrasoundImageOrientation = UF\n", "", "expected the field UltrasoundImageOrientation"),
        ("MET_UCHAR", "MET_STRING", "expected ElementType MET_UCHAR"),
        ("4 3 2", "4 3 9", "expected 108 bytes of pixels, found 24"),
        ("4 3 2", "4 3 x", "expected DimSize with whole numbers"),
        ("4 3 2", "4 3 2 1 1", "expected DimSize 'width height count'"),
        ("NDims = 3\n", "NDims 3\n", "expected a MetaImage header"),
        ("NDims = 3\n", "NDims = 3\nKinds = list domain domain\n", "expected the frames as the last axis"),
        ("NDims = 3\n", "NDims = 3\nCompressedData = True\n", "expected zlib-compressed pixels"),
        ("LOCAL", "absent.raw", "expected its voxels in .*absent.raw, received nothing there"),
    ],
)
def test_broken_files_are_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(InputError, match=rf"a\.igs\.mha: {message}"):
        read_metaimage(written(tmp_path, HEADER.replace(old, new)))


def test_truncated_compressed_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "c.igs.mha"
    whole = metaimage_bytes(PlusSequence(PIXELS, ({}, {})), compressed=True)
    path.write_bytes(whole[:-12])
    with pytest.raises(
        InputError, match=r"c\.igs\.mha: expected zlib-compressed pixels with their end, .*cut short"
    ):
        read_metaimage(path)


def test_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.mha: expected a file, received nothing there"):
        read_metaimage(tmp_path / "none.mha")


@pytest.mark.parametrize("orientation", ["UltrasoundImageOrientation = MFA\n", ""])
def test_a_placeholder_of_one_pixel_is_no_image(tmp_path: Path, orientation: str) -> None:
    header = HEADER.replace("UltrasoundImageOrientation = UF\n", orientation).replace("4 3 2", "1 1 2")
    sequence = read_metaimage(written(tmp_path, header, b"00"))
    assert sequence.tracker_only
    assert sequence.frame_fields == ({}, {"Timestamp": "2.5"})
