"""Segments by name, and where the scan ends that a cropped segmentation was made from."""

from __future__ import annotations

import numpy as np
import pytest
from volumes import OBLIQUE, voxel_axes

from registration import transforms
from registration.io.segments import Segment, read_segments, scan_ends

RAS_FROM_LPS = np.diag([-1.0, -1.0, 1.0, 1.0])
SCAN = voxel_axes((0.5, 0.6, 1.5), OBLIQUE, (10.0, -20.0, 30.0))
WHOLE = [[0, 4], [0, 5], [0, 6]]


def geometry(ct_A_scan: np.ndarray, extent: list[list[int]]) -> dict[str, str]:
    """The header's key as 3D Slicer writes it: parameters between &, value and description after |."""
    numbers = [*(RAS_FROM_LPS @ ct_A_scan).reshape(-1), *np.array(extent).reshape(-1)]
    text = "Crop to reference image geometry|0|Crop.&Reference image geometry|"
    text += (
        ";".join(f"{number:.17g}" for number in numbers)
        + ";|Image geometry description string.&Smoothing|0.5|"
    )
    return {"Segmentation_ConversionParameters": text}


def test_names_layers_and_labels() -> None:
    facts = {
        "Segment0_LabelValue": "3",
        "Segment0_Name": "aorta",
        "Segment0_ID": "Segment_1",
        "Segment10_LabelValue": "1",
        "Segment10_Layer": "1",
        "Segment2_LabelValue": "many",
        "Segment3_Name": "no label",
    }
    assert read_segments(facts) == (Segment(3, 0, "aorta", "Segment_1"), Segment(1, 1, "", ""))
    assert read_segments({}) == ()


def test_a_file_cropped_out_of_the_scan() -> None:
    file = SCAN @ transforms.translation((2.0, 0.0, 1.0))
    found = scan_ends(geometry(SCAN, [[0, 9], [0, 5], [0, 20]]), (5, 6, 7), file)
    np.testing.assert_array_equal(found, [[-2, 7], [0, 5], [-1, 19]])
    # Indices of a scan may begin elsewhere than at 0.
    file = SCAN @ transforms.translation((102.0, 0.0, 1.0))
    found = scan_ends(geometry(SCAN, [[100, 109], [0, 5], [0, 20]]), (5, 6, 7), file)
    np.testing.assert_array_equal(found, [[-2, 7], [0, 5], [-1, 19]])


def test_a_file_larger_than_the_scan() -> None:
    file = SCAN @ transforms.translation((-1.0, -1.0, 0.0))
    np.testing.assert_array_equal(
        scan_ends(geometry(SCAN, [[0, 3], [0, 3], [0, 6]]), (5, 6, 7), file), [[1, 4], [1, 4], [0, 6]]
    )


def test_a_segmentation_finer_than_the_scan_with_flipped_axes() -> None:
    # Twice as fine: the voxels' outer sides coincide, not their centres; the first axis runs the other way.
    finer = SCAN @ np.array([[-0.5, 0, 0, 3.25], [0, 0.5, 0, -0.25], [0, 0, 0.5, 1.75], [0, 0, 0, 1]])
    found = scan_ends(geometry(SCAN, [[0, 4], [0, 5], [0, 6]]), (4, 12, 4), finer)
    np.testing.assert_array_equal(found, [[-2, 7], [0, 11], [-4, 9]])


@pytest.mark.parametrize(
    "facts",
    [
        {},
        {"Segmentation_ReferenceImageExtentOffset": "2 0"},
        {"Segmentation_ConversionParameters": "Reference image geometry|1;0;0;|"},
        {"Segmentation_ConversionParameters": ""},
        geometry(SCAN @ np.diag([0.0, 1, 1, 1]), [[0, 9], [0, 9], [0, 9]]),
        # A reference whose axes are no axes of the file.
        geometry(voxel_axes((1.0, 1.0, 1.0), np.eye(3), (0, 0, 0)), [[0, 9], [0, 9], [0, 9]]),
    ],
)
def test_without_its_place_the_scan_ends_with_the_file(facts: dict[str, str]) -> None:
    np.testing.assert_array_equal(scan_ends(facts, (5, 6, 7), SCAN), WHOLE)


def test_the_offset_alone_says_where_the_scan_begins() -> None:
    facts = {"Segmentation_ReferenceImageExtentOffset": "35 0 -1"}
    np.testing.assert_array_equal(scan_ends(facts, (5, 6, 7), SCAN), [[-35, 4], [0, 5], [1, 6]])
