"""Where voxels lie in the patient, whatever the file's axes, and which of them are the vessel."""

from __future__ import annotations

import gzip
import struct
from pathlib import Path

import numpy as np
import pytest
import SimpleITK
from volumes import OBLIQUE, metaimage_bytes, nifti_bytes, nrrd_bytes, voxel_axes, write_volume

from registration.ct_model.label_map import LabelMap, read_label_map
from registration.ct_model.vessel_mask import vessel_mask
from registration.errors import InputError

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
        ("LAS", np.diag([1.0, -1.0, 1.0, 1.0])),
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


def test_transforms_of_nifti_that_differ_need_a_choice(tmp_path: Path) -> None:
    elsewhere = voxel_axes((0.5, 0.6, 1.5), OBLIQUE @ np.diag([1.0, 1.0, -1.0]), (18.0, -20.0, 30.0))
    content = nifti_bytes(LABELS, AXES, (1, 1), qform=elsewhere)
    (tmp_path / "a.nii").write_bytes(content)
    (tmp_path / "a.nii.gz").write_bytes(gzip.compress(content))
    for name in ("a.nii", "a.nii.gz"):
        with pytest.raises(
            InputError, match=rf"{name}: expected qform and sform that agree, found voxels up to .* mm apart"
        ):
            read_label_map(tmp_path / name)
        for form, ras in (("sform", AXES), ("qform", elsewhere)):
            found = read_label_map(tmp_path / name, nifti_form=form)
            np.testing.assert_allclose(found.ct_A_voxel, LPS_FROM_RAS @ ras, atol=1e-5)
            np.testing.assert_array_equal(found.labels, LABELS)
    # The user's file is as it was.
    assert (tmp_path / "a.nii").read_bytes() == content


def test_a_sheared_sform_that_was_not_chosen_does_not_matter(tmp_path: Path) -> None:
    sheared = AXES.copy()
    sheared[0, 1] += 0.3
    (tmp_path / "a.nii").write_bytes(nifti_bytes(LABELS, sheared, (1, 1), qform=AXES))
    found = read_label_map(tmp_path / "a.nii", nifti_form="qform")
    # The voxels' size is that of the header's pixdim.
    np.testing.assert_allclose(found.ct_A_voxel[:3, [0, 2]], (LPS_FROM_RAS @ AXES)[:3, [0, 2]], atol=1e-5)
    with pytest.raises(InputError, match=r"a\.nii: expected axes at right angles"):
        read_label_map(tmp_path / "a.nii", nifti_form="sform")


@pytest.mark.parametrize(("code", "per_unit"), [(1, 1000.0), (2, 1.0), (3, 1e-3), (0, 1.0)])
@pytest.mark.parametrize("codes", [(0, 1), (1, 0), (1, 1)])
def test_every_unit_of_nifti(tmp_path: Path, code: int, per_unit: float, codes: tuple[int, int]) -> None:
    stored = np.diag([1 / per_unit, 1 / per_unit, 1 / per_unit, 1.0]) @ AXES
    (tmp_path / "a.nii").write_bytes(nifti_bytes(LABELS, stored, codes, qform=stored, units=code))
    np.testing.assert_allclose(
        read_label_map(tmp_path / "a.nii").ct_A_voxel, LPS_FROM_RAS @ AXES, rtol=1e-5, atol=1e-4
    )


def test_units_of_nrrd_and_metaimage(tmp_path: Path) -> None:
    centimetres = np.diag([0.1, 0.1, 0.1, 1.0]) @ AXES
    (tmp_path / "a.nrrd").write_bytes(nrrd_bytes(LABELS, "LPS", centimetres, 'space units: "cm" "cm" "cm"\n'))
    found = read_label_map(tmp_path / "a.nrrd")
    np.testing.assert_allclose(found.ct_A_voxel, AXES, atol=1e-9)
    assert found.units == "cm"
    # What the user says of the file's numbers comes first.
    np.testing.assert_allclose(
        read_label_map(tmp_path / "a.nrrd", units="m").ct_A_voxel,
        np.diag([1000.0, 1000.0, 1000.0, 1.0]) @ centimetres,
        atol=1e-6,
    )
    (tmp_path / "b.nrrd").write_bytes(nrrd_bytes(LABELS, "RAS", AXES, 'space units: "foot" "foot" "foot"\n'))
    with pytest.raises(InputError, match=r"b\.nrrd: expected space units of mm, cm, m, um for every axis"):
        read_label_map(tmp_path / "b.nrrd")
    content = metaimage_bytes(LABELS, "1 0 0 0 1 0 0 0 1").replace(b"NDims", b"DistanceUnits = cm\nNDims")
    (tmp_path / "a.mha").write_bytes(content)
    found = read_label_map(tmp_path / "a.mha")
    expected = [[10.0, 0, 0, 70], [0, 10, 0, 80], [0, 0, 10, 90], [0, 0, 0, 1]]
    np.testing.assert_allclose(found.ct_A_voxel, expected)


def test_units_of_axes_without_directions(tmp_path: Path) -> None:
    head = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 7 6 5\nspacings: 0.05 0.06 0.15\n"
    head += 'units: "cm" "cm" "cm"\nencoding: raw\n\n'
    (tmp_path / "a.nrrd").write_bytes(head.encode() + LABELS.tobytes(order="F"))
    found = read_label_map(tmp_path / "a.nrrd", "lps")
    np.testing.assert_allclose(found.spacing_mm, [0.5, 0.6, 1.5])


def test_a_left_handed_space_of_nrrd_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.nrrd").write_bytes(nrrd_bytes(LABELS, "3D-left-handed", AXES))
    with pytest.raises(InputError, match=r"a\.nrrd: expected axes of the patient or right-handed ones"):
        read_label_map(tmp_path / "a.nrrd", "lps")


def test_a_fourth_axis_of_one_entry_is_no_film(tmp_path: Path) -> None:
    content = bytearray(nifti_bytes(LABELS, AXES, (0, 1)))
    struct.pack_into("<8h", content, 40, 4, *LABELS.shape, 1, 1, 1, 1)
    (tmp_path / "a.nii").write_bytes(content)
    found = read_label_map(tmp_path / "a.nii")
    np.testing.assert_array_equal(found.labels, LABELS)
    np.testing.assert_allclose(found.ct_A_voxel, LPS_FROM_RAS @ AXES, atol=1e-5)


def test_layers_of_segments_that_overlap(tmp_path: Path) -> None:
    second = np.zeros_like(LABELS)
    second[2:6, 1:4, 1:4] = 3
    layers = np.stack([LABELS, second])
    vectors = " ".join("(" + ",".join(f"{value:.12g}" for value in AXES[:3, axis]) + ")" for axis in range(3))
    head = (
        "NRRD0004\ntype: uint8\ndimension: 4\nspace: left-posterior-superior\nsizes: 2 7 6 5\n"
        f"kinds: list domain domain domain\nspace directions: none {vectors}\nspace origin: (10,-20,30)\n"
        "encoding: gzip\nSegment0_LabelValue:=3\nSegment0_Layer:=0\nSegment0_Name:=lumen\nSegment0_ID:=Segment_1\n"
        "Segment1_LabelValue:=3\nSegment1_Layer:=1\nSegment1_Name:=wall\nSegment1_ID:=Segment_2\n"
        "Segment2_LabelValue:=5\nSegment2_Layer:=0\nSegment2_Name:=vein\nSegment3_LabelValue:=4\nSegment3_Layer:=1\n"
        "Segment3_Name:=empty\n\n"
    )
    (tmp_path / "a.seg.nrrd").write_bytes(head.encode() + gzip.compress(layers.tobytes(order="F")))
    found = read_label_map(tmp_path / "a.seg.nrrd")
    np.testing.assert_allclose(found.ct_A_voxel, AXES, atol=1e-9)
    for label, values, number in (
        ("lumen", LABELS, 3),
        ("wall", second, 3),
        ("Segment_2", second, 3),
        (5, LABELS, 5),
    ):
        mask = vessel_mask(found, label)
        assert (mask.label, int(mask.inside.sum())) == (number, int((values == number).sum()))
    assert vessel_mask(found, "Segment_2").name == "wall"
    for choice, message in (
        (3, r"expected the name of one of lumen, wall, vein, empty, received 3, which 2 of them have"),
        ("aorta", r"expected the name of one of lumen, .*, received 'aorta', which 0 of them have"),
        (None, r"expected the name of one of lumen, wall, vein, empty, received none"),
        ("empty", "expected a segment with voxels, received empty, which has none"),
    ):
        with pytest.raises(InputError, match=f"label: {message}"):
            vessel_mask(found, choice)


def test_a_segment_by_name(tmp_path: Path) -> None:
    more = "Segment0_LabelValue:=3\nSegment0_Name:=aorta\nSegment1_LabelValue:=5\nSegment1_Name:=vein\n"
    (tmp_path / "a.seg.nrrd").write_bytes(nrrd_bytes(LABELS, "LPS", AXES, more))
    found = read_label_map(tmp_path / "a.seg.nrrd")
    assert [vessel_mask(found, name).label for name in ("aorta", "vein")] == [3, 5]
    (tmp_path / "b.nrrd").write_bytes(nrrd_bytes(LABELS, "LPS", AXES))
    with pytest.raises(
        InputError, match="label: expected a number, because the file names no segments, received 'a"
    ):
        vessel_mask(read_label_map(tmp_path / "b.nrrd"), "aorta")


def test_a_segmentation_cropped_to_its_segment_is_not_cut_by_the_scan(tmp_path: Path) -> None:
    # The scan has 20 x 6 x 9 voxels; the vessel reaches its low end along k alone, and the file ends with the vessel.
    vessel = np.ones((4, 3, 5), dtype=np.uint8)
    crop = AXES @ voxel_axes((1.0, 1.0, 1.0), np.eye(3), (8.0, 2.0, 0.0))
    numbers = [*(LPS_FROM_RAS @ AXES).reshape(-1), 0, 19, 0, 5, 0, 8]
    more = "Segment0_LabelValue:=1\nSegment0_Name:=aorta\nSegmentation_ReferenceImageExtentOffset:=8 2 0\n"
    place = ";".join(f"{number:.17g}" for number in numbers)
    more += (
        f"Segmentation_ConversionParameters:=Smoothing factor|0.5|x&Reference image geometry|{place};|text&\n"
    )
    (tmp_path / "a.seg.nrrd").write_bytes(nrrd_bytes(vessel, "LPS", crop, more))
    mask = vessel_mask(read_label_map(tmp_path / "a.seg.nrrd"))
    assert mask.cut.tolist() == [[False, False], [False, False], [True, False]]
    # Without that, the file is all there is.
    (tmp_path / "b.nrrd").write_bytes(nrrd_bytes(vessel, "LPS", crop))
    assert vessel_mask(read_label_map(tmp_path / "b.nrrd")).cut.all()
