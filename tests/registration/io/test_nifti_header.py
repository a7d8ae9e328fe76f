"""The two transforms of NIfTI files, against SimpleITK where there is only one of them."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
import SimpleITK
from volumes import OBLIQUE, nifti_bytes, voxel_axes

from registration.errors import InputError
from registration.io.nifti_header import read_nifti_header

LABELS = np.zeros((7, 6, 5), dtype=np.uint8)
RAS = voxel_axes((0.5, 0.6, 1.5), OBLIQUE, (-12.0, 34.0, 56.0))
MIRRORED = voxel_axes((0.5, 0.6, 1.5), OBLIQUE @ np.diag([1.0, 1.0, -1.0]), (-12.0, 34.0, 56.0))
LPS_FROM_RAS = np.diag([-1.0, -1.0, 1.0, 1.0])


def by_simpleitk(path: Path) -> np.ndarray:
    image = SimpleITK.ReadImage(str(path))
    matrix = np.eye(4)
    matrix[:3, :3] = np.array(image.GetDirection()).reshape(3, 3) * image.GetSpacing()
    matrix[:3, 3] = image.GetOrigin()
    return LPS_FROM_RAS @ matrix


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("matrix", [RAS, MIRRORED], ids=["right-handed", "left-handed"])
@pytest.mark.parametrize("codes", [(1, 0), (0, 1), (2, 4)])
def test_the_transform_that_is_there(
    tmp_path: Path, order: str, matrix: np.ndarray, codes: tuple[int, int]
) -> None:
    path = tmp_path / "a.nii"
    path.write_bytes(nifti_bytes(LABELS, matrix, codes, order, qform=matrix))
    header = read_nifti_header(path, path)
    name, found = header.ras_A_voxel(None, 1.0, path)
    assert name == ("qform" if codes[1] == 0 else "sform")
    np.testing.assert_allclose(found, matrix, atol=1e-5)
    np.testing.assert_allclose(found, by_simpleitk(path), atol=1e-5)
    assert header.bytes == path.stat().st_size


def test_the_second_version_of_the_format(tmp_path: Path) -> None:
    image = SimpleITK.GetImageFromArray(LABELS)
    image.SetOrigin((1.0, 2.0, 3.0))
    image.SetSpacing((0.5, 0.6, 1.5))
    image.SetDirection(OBLIQUE.reshape(-1).tolist())
    path = tmp_path / "a.nii"
    SimpleITK.WriteImage(image, str(path))
    first = read_nifti_header(path, path)
    # By hand from the first version: wider numbers at other places, after nifti2.h.
    assert first.sform is not None
    head = bytearray(544)
    struct.pack_into("<i", head, 0, 540)
    struct.pack_into("<hh", head, 12, 2, 8)
    struct.pack_into("<8q", head, 16, 3, *first.sizes, 1, 1, 1, 1)
    struct.pack_into("<8d", head, 104, 1, *first.spacing, 0, 0, 0, 0)
    struct.pack_into("<q", head, 168, 544)
    struct.pack_into("<ii", head, 344, 0, 1)
    struct.pack_into("<12d", head, 400, *first.sform[:3].reshape(-1))
    struct.pack_into("<i", head, 500, 2)
    path.write_bytes(bytes(head) + LABELS.tobytes())
    second = read_nifti_header(path, path)
    assert (second.sizes, second.units, second.bytes) == ((5, 6, 7), "mm", path.stat().st_size)
    np.testing.assert_allclose(second.ras_A_voxel(None, 1.0, path)[1], first.sform)


@pytest.mark.parametrize(
    ("qform", "apart"),
    [(RAS + np.array([[0, 0, 0, 30.0], [0] * 4, [0] * 4, [0] * 4]), "30"), (MIRRORED, "12")],
    ids=["elsewhere", "mirrored"],
)
def test_transforms_that_differ_need_a_choice(tmp_path: Path, qform: np.ndarray, apart: str) -> None:
    path = tmp_path / "a.nii"
    path.write_bytes(nifti_bytes(LABELS, RAS, (1, 1), qform=qform))
    header = read_nifti_header(path, path)
    with pytest.raises(
        InputError,
        match=rf"a\.nii: expected qform and sform that agree, found voxels up to {apart} mm apart "
        r"\(nifti_form=qform or nifti_form=sform chooses\)",
    ):
        header.ras_A_voxel(None, 1.0, path)
    np.testing.assert_allclose(header.ras_A_voxel("sform", 1.0, path)[1], RAS, atol=1e-5)
    np.testing.assert_allclose(header.ras_A_voxel("qform", 1.0, path)[1], qform, atol=1e-5)


def test_transforms_that_differ_by_rounding_agree(tmp_path: Path) -> None:
    path = tmp_path / "a.nii"
    path.write_bytes(nifti_bytes(LABELS, np.round(RAS, 3), (1, 1), qform=RAS))
    assert read_nifti_header(path, path).ras_A_voxel(None, 1.0, path)[0] == "sform"


def test_a_transform_that_is_not_there_cannot_be_chosen(tmp_path: Path) -> None:
    path = tmp_path / "a.nii"
    path.write_bytes(nifti_bytes(LABELS, RAS, (0, 1)))
    with pytest.raises(InputError, match=r"nifti_form: expected sform, as .*a\.nii has it, received qform"):
        read_nifti_header(path, path).ras_A_voxel("qform", 1.0, path)


@pytest.mark.parametrize(
    ("codes", "place", "kind", "values", "message"),
    [
        ((1, 0), 76, "8f", (1, 0, 0, 0, 0, 0, 0, 0), "qform: expected an invertible matrix"),
        ((0, 0), 76, "8f", (1, 0.5, 0, 1, 0, 0, 0, 0), "pixdim: expected an invertible matrix"),
        ((1, 1), 280, "f", (np.nan,), "sform: expected finite entries"),
        ((0, 1), 40, "8h", (3, 7, -6, 5, 1, 1, 1, 1), "expected 1 to 7 axes of one voxel at least"),
        ((0, 1), 40, "8h", (300, 7, 6, 5, 1, 1, 1, 1), "expected 1 to 7 axes of one voxel at least"),
    ],
)
def test_headers_of_no_volume_are_refused(
    tmp_path: Path, codes: tuple[int, int], place: int, kind: str, values: tuple[float, ...], message: str
) -> None:
    content = bytearray(nifti_bytes(LABELS, RAS, codes, qform=RAS))
    struct.pack_into("<" + kind, content, place, *values)
    path = tmp_path / "a.nii"
    path.write_bytes(content)
    with pytest.raises(InputError, match=rf"a\.nii: {message}"):
        read_nifti_header(path, path).ras_A_voxel(None, 1.0, path)


@pytest.mark.parametrize(("code", "units"), [(0, ""), (1, "m"), (2, "mm"), (3, "um"), (2 + 8, "mm")])
def test_the_unit_of_length(tmp_path: Path, code: int, units: str) -> None:
    path = tmp_path / "a.nii"
    path.write_bytes(nifti_bytes(LABELS, RAS, (0, 1), units=code))
    assert read_nifti_header(path, path).units == units


def test_an_unknown_unit_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.nii"
    path.write_bytes(nifti_bytes(LABELS, RAS, (0, 1), units=5))
    with pytest.raises(InputError, match="expected a length in m, mm or um, found code 5 in xyzt_units"):
        read_nifti_header(path, path)
