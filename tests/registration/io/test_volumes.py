"""Volumes of every format read as written, and refused when a part of them is missing."""

from __future__ import annotations

import bz2
import gzip
import os
import zlib
from pathlib import Path

import numpy as np
import pytest
import SimpleITK
from volumes import OBLIQUE, nifti_bytes, voxel_axes, write_volume

from registration.ct_model.label_map import LabelMap
from registration.errors import InputError
from registration.io.volumes import read_volume, volume_suffix

LABELS = np.random.default_rng(0).integers(0, 3, (13, 12, 11)).astype(np.uint8)
MAP = LabelMap(LABELS, voxel_axes((0.5, 0.6, 1.5), OBLIQUE, (10.0, -20.0, 30.0)), {})


def values(path: Path) -> np.ndarray:
    return np.asarray(SimpleITK.GetArrayFromImage(read_volume(path))).transpose(2, 1, 0)


@pytest.mark.parametrize(
    "name, suffix",
    [("a.nii.gz", ".nii.gz"), ("a.NII", ".nii"), ("b.seg.nrrd", ".nrrd"), ("a.gz", ""), ("nii", "")],
)
def test_suffixes(name: str, suffix: str) -> None:
    assert volume_suffix(Path(name)) == suffix


@pytest.mark.parametrize("compressed", [True, False])
@pytest.mark.parametrize(
    "name",
    ["a.nii", "a.nii.gz", "a.nrrd", "a.nhdr", "a.mha", "a.mhd", "A.NRRD"],
)
def test_every_format_reads_as_written(tmp_path: Path, name: str, compressed: bool) -> None:
    write_volume(tmp_path / name, MAP, compressed)
    np.testing.assert_array_equal(values(tmp_path / name), LABELS)


@pytest.mark.parametrize("suffix", ["nii", "nii.gz", "nrrd", "nhdr", "mha", "mhd"])
def test_suffixes_in_capitals(tmp_path: Path, suffix: str) -> None:
    # Programs do not write such names; people and old file servers do.
    write_volume(tmp_path / f"a.{suffix}", MAP).rename(tmp_path / f"A.{suffix.upper()}")
    np.testing.assert_array_equal(values(tmp_path / f"A.{suffix.upper()}"), LABELS)


@pytest.mark.parametrize("share", [0.05, 0.5, 0.97])
@pytest.mark.parametrize("compressed", [True, False])
@pytest.mark.parametrize("name", ["a.nii", "a.nii.gz", "a.nrrd", "a.mha"])
def test_a_file_that_was_cut_short_is_refused(
    tmp_path: Path, name: str, compressed: bool, share: float, capfd: pytest.CaptureFixture[str]
) -> None:
    path = write_volume(tmp_path / name, MAP, compressed)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(InputError, match=name) as refusal:
        read_volume(path)
    assert "\n" not in str(refusal.value)
    assert capfd.readouterr() == ("", "")


def test_a_cut_nifti_is_told_by_its_size(tmp_path: Path) -> None:
    # SimpleITK reads such a file without a word and fills it up with zeros.
    whole = nifti_bytes(LABELS, np.eye(4), (0, 1))
    (tmp_path / "a.nii").write_bytes(whole[:-1])
    with pytest.raises(
        InputError, match=f"expected at least {len(whole)} bytes of it, received {len(whole) - 1}: cut"
    ):
        read_volume(tmp_path / "a.nii")
    (tmp_path / "a.nii.gz").write_bytes(gzip.compress(whole[:-1]))
    with pytest.raises(InputError, match=r"a\.nii\.gz: .*cut short"):
        read_volume(tmp_path / "a.nii.gz")


def test_bytes_in_the_other_order(tmp_path: Path) -> None:
    (tmp_path / "a.nii").write_bytes(nifti_bytes(LABELS, np.eye(4), (0, 1), order=">"))
    np.testing.assert_array_equal(values(tmp_path / "a.nii"), LABELS)


def test_a_namesake_without_gz_is_not_read_instead(tmp_path: Path) -> None:
    write_volume(tmp_path / "a.nii", MAP)
    other = LabelMap((2 - LABELS).astype(np.uint8), MAP.ct_A_voxel, {})
    write_volume(tmp_path / "a.nii.gz", other)
    np.testing.assert_array_equal(values(tmp_path / "a.nii.gz"), 2 - LABELS)


def test_voxels_in_a_file_of_their_own(tmp_path: Path) -> None:
    write_volume(tmp_path / "a.mhd", MAP)
    data = next(path for path in tmp_path.iterdir() if path.suffix != ".mhd")
    os.truncate(data, data.stat().st_size - 1)
    with pytest.raises(InputError, match=r"a\.mhd: .*cut short"):
        read_volume(tmp_path / "a.mhd")
    data.unlink()
    with pytest.raises(InputError, match=r"a\.mhd: expected its voxels in .*a\.raw, received nothing there"):
        read_volume(tmp_path / "a.mhd")


@pytest.mark.parametrize(
    "name, content, message",
    [
        ("a.nii", b"rubbish", "expected the header of a NIfTI volume"),
        ("a.nii", b"", "expected the header of a NIfTI volume"),
        ("a.nii.gz", b"rubbish", "expected a complete gzip file"),
        ("a.nrrd", b"rubbish", "expected an NRRD file"),
        ("a.mha", b"rubbish", "expected a MetaImage header that ends in ElementDataFile"),
        (
            "a.mha",
            b"NDims = 3\nElementDataFile = LOCAL\n",
            "expected DimSize with whole numbers, found None",
        ),
        ("a.doc", b"rubbish", r"expected one of \.nii, .*, received \.doc"),
        ("a", b"rubbish", "received no suffix"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, name: str, content: bytes, message: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=rf"/{name}: .*{message}"):
        read_volume(tmp_path / name)


def test_missing_files_and_folders_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.nrrd: expected a file, received nothing there"):
        read_volume(tmp_path / "none.nrrd")
    (tmp_path / "folder.nrrd").mkdir()
    with pytest.raises(InputError, match="received a folder"):
        read_volume(tmp_path / "folder.nrrd")


def test_skipped_bytes_and_headers_of_detached_voxels(tmp_path: Path) -> None:
    raw = LABELS.tobytes(order="F")
    (tmp_path / "v.raw").write_bytes(b"another header" + raw)
    (tmp_path / "a.nhdr").write_bytes(
        b"NRRD0004\ntype: uint8\ndimension: 3\nspace: LPS\nsizes: 13 12 11\nencoding: raw\nbyte skip: -1\n"
        b"space directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: (0,0,0)\ndata file: v.raw\n\n"
    )
    head = "ObjectType = Image\nNDims = 3\nBinaryData = True\nHeaderSize = 14\nDimSize = 13 12 11\n"
    head += "ElementType = MET_UCHAR\nElementDataFile = v.raw\n"
    (tmp_path / "a.mhd").write_text(head)
    for name in ("a.nhdr", "a.mhd"):
        np.testing.assert_array_equal(values(tmp_path / name), LABELS)


def test_bzip2_which_simpleitk_cannot_unpack(tmp_path: Path) -> None:
    (tmp_path / "a.nrrd").write_bytes(
        b"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 13 12 11\nencoding: bzip2\n\n"
        + bz2.compress(LABELS.tobytes(order="F"))
    )
    np.testing.assert_array_equal(values(tmp_path / "a.nrrd"), LABELS)


def test_packed_voxels_with_a_wrong_sum_or_without_a_size(tmp_path: Path) -> None:
    # SimpleITK reads the first for good and other numbers from the second.
    packed = zlib.compress(LABELS.tobytes(order="F"))
    head = "ObjectType = Image\nNDims = 3\nBinaryData = True\nCompressedData = True\n{}DimSize = 13 12 11\n"
    head += "ElementType = MET_UCHAR\nElementDataFile = LOCAL\n"
    size = f"CompressedDataSize = {len(packed)}\n"
    (tmp_path / "a.mha").write_bytes(head.format(size).encode() + packed[:-1] + bytes([packed[-1] ^ 1]))
    with pytest.raises(InputError, match=r"a\.mha: expected zlib-compressed pixels, found broken data"):
        read_volume(tmp_path / "a.mha")
    (tmp_path / "b.mha").write_bytes(head.format("").encode() + packed)
    np.testing.assert_array_equal(values(tmp_path / "b.mha"), LABELS)


def test_a_choice_between_transforms_is_one_of_nifti_files(tmp_path: Path) -> None:
    write_volume(tmp_path / "a.mha", MAP)
    for name, form in (("a.mha", "qform"), ("a.nii", "form")):
        write_volume(tmp_path / name, MAP)
        with pytest.raises(
            InputError, match="nifti_form: expected qform or sform, and that for NIfTI files alone"
        ):
            read_volume(tmp_path / name, nifti_form=form)


@pytest.mark.parametrize("length", [401, 1100, 30_000])
def test_an_nrrd_field_that_overflows_the_librarys_message_is_refused(tmp_path: Path, length: int) -> None:
    """The process ended where an unknown space had more than a thousand characters."""
    head = "NRRD0004\ntype: uint8\ndimension: 3\nspace: {}\nsizes: 2 2 2\nencoding: raw\n\n"
    (tmp_path / "a.nrrd").write_bytes(head.format("x" * length).encode() + bytes(8))
    with pytest.raises(
        InputError, match=r"a\.nrrd: expected NRRD fields of at most 400 characters, found 'space'"
    ):
        read_volume(tmp_path / "a.nrrd")


def test_an_nrrd_file_may_tell_at_length_how_it_was_made(tmp_path: Path) -> None:
    head = f"NRRD0004\ncontent: {'crop(' * 500}\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nencoding: raw\n\n"
    (tmp_path / "a.nrrd").write_bytes(head.encode() + bytes(range(8)))
    assert read_volume(tmp_path / "a.nrrd").GetSize() == (2, 2, 2)
