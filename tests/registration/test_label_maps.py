"""Where voxels lie in the patient, whatever the file's axes, and which of them are the vessel."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import SimpleITK
from volumes import OBLIQUE, metaimage_bytes, nifti_bytes, nrrd_bytes, voxel_axes, write_volume

from registration.errors import InputError
from registration.label_maps import LabelMap, read_label_map

LABELS = np.zeros((7, 6, 5), dtype=np.uint8)
LABELS[1:4, 2:5, 1:3] = 3
LABELS[6, 0, 4] = 5
LPS_FROM_RAS = np.diag([-1.0, -1.0, 1.0, 1.0])
AXES = voxel_axes((0.5, 0.6, 1.5), OBLIQUE, (10.0, -20.0, 30.0))
FLIPPED = voxel_axes((0.5, 0.6, 1.5), OBLIQUE @ np.diag([1.0, -1.0, 1.0]), (10.0, -20.0, 30.0))


@pytest.mark.parametrize("axes", [AXES, FLIPPED], ids=["right-handed", "left-handed"])
@pytest.mark.parametrize("name", ["a.nii", "a.nii.gz", "a.nrrd", "a.mha", "a.mhd"])
def test_spacing_origin_and_oblique_axes_of_every_format(tmp_path: Path, name: str, axes: np.ndarray) -> None:
    found = read_label_map(write_volume(tmp_path / name, LabelMap(LABELS, axes, {})))
    np.testing.assert_array_equal(found.labels, LABELS)
    # NIfTI holds single precision.
    np.testing.assert_allclose(found.ct_A_voxel, axes, atol=1e-5)
    np.testing.assert_allclose(found.spacing_mm, [0.5, 0.6, 1.5], rtol=1e-6)


def test_nifti_is_in_ras_and_comes_out_in_lps(tmp_path: Path) -> None:
    ras = voxel_axes((0.5, 0.6, 1.5), OBLIQUE, (-12.0, 34.0, 56.0))
    (tmp_path / "a.nii").write_bytes(nifti_bytes(LABELS, ras, (0, 1)))
    found = read_label_map(tmp_path / "a.nii")
    np.testing.assert_allclose(found.ct_A_voxel, LPS_FROM_RAS @ ras, atol=1e-5)
    np.testing.assert_array_equal(found.labels, LABELS)


@pytest.mark.parametrize(
    "space, lps_A_space",
    [
        ("left-posterior-superior", np.eye(4)),
        ("LPS", np.eye(4)),
        ("right-anterior-superior", LPS_FROM_RAS),
        ("RAS", LPS_FROM_RAS),
        ("left-anterior-superior", np.diag([1.0, -1.0, 1.0, 1.0])),
    ],
)
def test_every_space_that_nrrd_names(tmp_path: Path, space: str, lps_A_space: np.ndarray) -> None:
    (tmp_path / "a.nrrd").write_bytes(nrrd_bytes(LABELS, space, AXES))
    found = read_label_map(tmp_path / "a.nrrd")
    np.testing.assert_allclose(found.ct_A_voxel, lps_A_space @ AXES, atol=1e-6)
    np.testing.assert_array_equal(found.labels, LABELS)


def test_metaimage_is_in_lps_with_its_axes_in_rows(tmp_path: Path) -> None:
    # MetaImage lists where the first axis points, then the second: i runs along y, j along -x.
    (tmp_path / "a.mha").write_bytes(metaimage_bytes(LABELS, "0 1 0 -1 0 0 0 0 1"))
    found = read_label_map(tmp_path / "a.mha")
    expected = [[0, -1, 0, 7], [1, 0, 0, 8], [0, 0, 1, 9], [0, 0, 0, 1]]
    np.testing.assert_allclose(found.ct_A_voxel, expected)


@pytest.mark.parametrize("space", ["", "scanner-xyz"])
def test_nrrd_that_says_nothing_about_the_patient_needs_a_space(tmp_path: Path, space: str) -> None:
    (tmp_path / "a.nrrd").write_bytes(nrrd_bytes(LABELS, space, AXES))
    with pytest.raises(
        InputError, match=r"space: expected lps or ras, because the header of .*a\.nrrd does not say"
    ):
        read_label_map(tmp_path / "a.nrrd")
    np.testing.assert_allclose(read_label_map(tmp_path / "a.nrrd", "lps").ct_A_voxel, AXES, atol=1e-6)
    np.testing.assert_allclose(
        read_label_map(tmp_path / "a.nrrd", "ras").ct_A_voxel, LPS_FROM_RAS @ AXES, atol=1e-6
    )


def test_nifti_without_qform_and_sform_needs_a_space(tmp_path: Path) -> None:
    (tmp_path / "a.nii").write_bytes(nifti_bytes(LABELS, AXES, (0, 0)))
    with pytest.raises(InputError, match="space: expected lps or ras"):
        read_label_map(tmp_path / "a.nii")
    found = read_label_map(tmp_path / "a.nii", "ras")
    np.testing.assert_allclose(found.ct_A_voxel, np.diag([-0.5, -0.6, 1.5, 1.0]), atol=1e-6)


def test_a_space_beside_a_header_that_states_it_is_refused(tmp_path: Path) -> None:
    write_volume(tmp_path / "a.mha", LabelMap(LABELS, AXES, {}))
    with pytest.raises(
        InputError, match=r"space: expected none, because the header of .*a\.mha says.*received ras"
    ):
        read_label_map(tmp_path / "a.mha", "ras")
    with pytest.raises(InputError, match="space: expected lps or ras, received 'scanner'"):
        read_label_map(tmp_path / "a.mha", "scanner")


def test_sheared_axes_are_refused(tmp_path: Path) -> None:
    sheared = AXES.copy()
    sheared[0, 1] += 0.1
    (tmp_path / "a.nrrd").write_bytes(nrrd_bytes(LABELS, "LPS", sheared))
    (tmp_path / "a.mha").write_bytes(metaimage_bytes(LABELS, "1 0.2 0 0 1 0 0 0 1"))
    (tmp_path / "b.mha").write_bytes(metaimage_bytes(LABELS, "2 0 0 0 1 0 0 0 1"))
    for name in ("a.nrrd", "a.mha", "b.mha"):
        with pytest.raises(
            InputError, match=rf"{name}: expected orthonormal axes within 0\.001, received a defect"
        ):
            read_label_map(tmp_path / name)
    (tmp_path / "a.nii").write_bytes(nifti_bytes(LABELS, sheared, (0, 1)))
    with pytest.raises(
        InputError, match=r"a\.nii: expected axes at right angles, received a header with sheared"
    ):
        read_label_map(tmp_path / "a.nii")


def test_a_film_a_slice_and_a_colour_volume_are_refused(tmp_path: Path) -> None:
    image = SimpleITK.GetImageFromArray(LABELS)
    for name, other, message in (
        ("film.nii", SimpleITK.JoinSeries([image, image]), "received 4 axes of 5 x 6 x 7 x 2 with 1 a voxel"),
        ("slice.nii", image[:, :, 1], "received 2 axes of 5 x 6 with 1 a voxel"),
        ("colour.nrrd", SimpleITK.Compose(image, image), "received 3 axes of 5 x 6 x 7 with 2 a voxel"),
    ):
        SimpleITK.WriteImage(other, str(tmp_path / name))
        with pytest.raises(
            InputError, match=f"{name}: expected a volume of 3 axes with one label a voxel, {message}"
        ):
            read_label_map(tmp_path / name)


def test_whole_numbers_in_floating_point_are_labels_and_fractions_are_not(tmp_path: Path) -> None:
    whole = read_label_map(write_volume(tmp_path / "a.nii", LabelMap(LABELS.astype(np.float32), AXES, {})))
    np.testing.assert_array_equal(whole.labels, LABELS)
    assert np.issubdtype(whole.labels.dtype, np.integer)
    for value in (0.5, np.nan, np.inf):
        broken = LABELS.astype(np.float32)
        broken[0, 0, 0] = value
        write_volume(tmp_path / "b.nrrd", LabelMap(broken, AXES, {}))
        with pytest.raises(InputError, match=r"b\.nrrd: expected whole numbers as labels"):
            read_label_map(tmp_path / "b.nrrd")
