"""Which voxels of a label map are the vessel, and where they lie."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from volumes import OBLIQUE, nrrd_bytes, voxel_axes

from registration.ct_model.label_map import LabelMap, read_label_map
from registration.ct_model.vessel_mask import vessel_mask
from registration.errors import InputError

LABELS = np.zeros((7, 6, 5), dtype=np.uint8)
LABELS[1:4, 2:5, 1:3] = 3
LABELS[6, 0, 4] = 5
AXES = voxel_axes((0.5, 0.6, 1.5), OBLIQUE, (10.0, -20.0, 30.0))


def test_one_label_of_several_must_be_chosen(tmp_path: Path) -> None:
    more = "Segment0_LabelValue:=3\nSegment0_Name:=aorta\nSegment1_LabelValue:=5\n"
    (tmp_path / "a.nrrd").write_bytes(nrrd_bytes(LABELS, "LPS", AXES, more))
    found = read_label_map(tmp_path / "a.nrrd")
    with pytest.raises(
        InputError, match=r"label: expected one of 3 \(aorta\), 5, because there are 2, received none"
    ):
        vessel_mask(found)
    with pytest.raises(InputError, match=r"label: expected one of 3 \(aorta\), 5, received 4"):
        vessel_mask(found, 4)
    assert int(vessel_mask(found, 3).inside.sum()) == 18
    with pytest.raises(
        InputError, match="labels: expected at least one voxel with a label, received a map of zeros"
    ):
        vessel_mask(LabelMap(np.zeros_like(LABELS), AXES, {}))


def test_the_crop_keeps_every_voxel_where_it_was() -> None:
    mask = vessel_mask(LabelMap(LABELS, AXES, {}), 3)
    assert mask.inside.shape == (3, 3, 2)
    np.testing.assert_allclose(mask.ct_A_voxel @ [0, 0, 0, 1], AXES @ [1, 2, 1, 1])
    np.testing.assert_allclose(mask.ct_A_voxel @ [2, 1, 1, 1], AXES @ [3, 3, 2, 1])
    assert mask.volume_mm3 == pytest.approx(18 * 0.5 * 0.6 * 1.5)
    assert not mask.cut.any()
    assert (mask.pieces_dropped, mask.voxels_dropped, mask.voxels_filled) == (0, 0, 0)


def test_the_sides_where_the_scan_ends() -> None:
    mask = vessel_mask(LabelMap(LABELS, AXES, {}), 5)
    np.testing.assert_array_equal(mask.cut, [[False, True], [True, False], [False, True]])


def test_the_largest_piece_with_its_cavities_filled() -> None:
    labels = np.zeros((12, 9, 9), dtype=np.int16)
    labels[1:6, 1:6, 1:6] = 2
    labels[3, 3, 3] = 0
    labels[3, 4, 3] = 0
    # A hollow to the outside is no cavity, and a voxel at a corner belongs to the piece.
    labels[1:3, 2, 2] = 0
    labels[6, 6, 6] = 2
    labels[9:11, 2, 2] = 2
    mask = vessel_mask(LabelMap(labels, np.eye(4), {}))
    assert mask.inside.shape == (6, 6, 6)
    assert int(mask.inside.sum()) == 125 - 2 + 1
    assert not mask.inside[0, 1, 1]
    assert mask.inside[2, 2, 2]
    assert (mask.pieces_dropped, mask.voxels_dropped, mask.voxels_filled, mask.label) == (1, 2, 2, 2)


def test_a_grey_image_is_not_taken_for_a_label_map() -> None:
    grey = np.arange(-200, 200, dtype=np.int16).reshape(10, 10, 4)
    with pytest.raises(
        InputError, match="labels: expected a label map, received 399 different values from -200 to 199"
    ):
        vessel_mask(LabelMap(grey, np.eye(4), {}))
    many = np.arange(100, dtype=np.int16).reshape(5, 5, 4)
    with pytest.raises(
        InputError, match=r"label: expected one of 1, .*, 19, 20 and 79 more, because there are 99"
    ):
        vessel_mask(LabelMap(many, np.eye(4), {}))
