"""Frames in a volume: voxels worked out by hand, and PLUS's own reconstructions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from registration import transforms
from registration.errors import InputError
from registration.readers.plus.reader import PlusReader
from registration.reconstruction.volume_compounding import VolumeGrid, VolumePlacement, compare
from registration.synchronisation import synchronise

IMAGE = np.array([[[10, 20, 30], [40, 50, 60]]], dtype=np.uint8)


def test_pixels_fall_where_the_pose_puts_them() -> None:
    # Columns run along -y, rows along z; 1 mm pixels and voxels.
    pose = np.array([[0, 0, 1, 4.0], [-1, 0, 0, 2.0], [0, 1, 0, 7.0], [0, 0, 0, 1]])
    grid = VolumeGrid(np.array([4.0, 0.0, 7.0]), 1.0, (1, 3, 2))
    placed = VolumePlacement(1.0, "nearest", "latest")(IMAGE, pose[None], grid)
    np.testing.assert_array_equal(placed.values[:, :, 0], [[30, 20, 10], [60, 50, 40]])
    assert placed.filled.all()


def test_linear_weights_share_a_pixel_among_voxels() -> None:
    grid = VolumeGrid(np.zeros(3), 1.0, (4, 3, 2))
    pose = transforms.translation((0.25, 0.0, 0.0))
    placed = VolumePlacement(1.0)(IMAGE[:, :1, :1] * 0 + 100, pose[None], grid)
    np.testing.assert_allclose(placed.values[0, 0], [100, 100, 0, 0])
    placed = VolumePlacement(1.0)(IMAGE[:, :1], pose[None], grid)
    # Voxel 1 takes a quarter of pixel 0 and three quarters of pixel 1.
    assert placed.values[0, 0, 1] == pytest.approx(0.25 * 10 + 0.75 * 20)
    assert placed.filled[0, 0].tolist() == [True, True, True, True]


@pytest.mark.parametrize(("compounding", "expected"), [("latest", 20.0), ("mean", 15.0)])
def test_compounding(compounding: str, expected: float) -> None:
    images = np.array([[[10]], [[20]]], dtype=np.uint8)
    grid = VolumeGrid(np.zeros(3), 1.0, (1, 1, 1))
    placed = VolumePlacement(1.0, "nearest", compounding)(images, np.tile(np.eye(4), (2, 1, 1)), grid)
    assert placed.values[0, 0, 0] == expected


def test_pixels_outside_the_grid_or_the_clip_are_left_out() -> None:
    grid = VolumeGrid(np.array([1.0, 0.0, 0.0]), 1.0, (9, 9, 1))
    placed = VolumePlacement(1.0, "nearest", "latest")(IMAGE, np.eye(4)[None], grid)
    assert placed.filled.sum() == 4
    clipped = VolumePlacement(1.0, "nearest", "latest", clip_origin_px=(2, 0), clip_size_px=(5, 5))
    assert clipped(IMAGE, np.eye(4)[None], grid).values[:, :, 1].max() == 60
    assert clipped(IMAGE, np.eye(4)[None], grid).filled.sum() == 2


def test_agreement_counts() -> None:
    grid = VolumeGrid(np.zeros(3), 1.0, (3, 2, 1))
    placed = VolumePlacement(1.0, "nearest", "latest")(IMAGE[:, :, :2], np.eye(4)[None], grid)
    reference = np.array([[[10, 24, 9], [0, 50, 0]]], dtype=np.uint8)
    agreement = compare(placed, reference)
    assert agreement.reference_covered == 0.75
    assert agreement.difference_mean == pytest.approx(4 / 3)
    assert agreement.same_share == pytest.approx(2 / 3)
    with pytest.raises(InputError, match=r"reference: expected shape \(1, 2, 3\), received"):
        compare(placed, reference[:, :1])
    with pytest.raises(InputError, match="voxels in common"):
        compare(placed, reference * 0)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"spacing_mm": 0.0}, "spacing_mm"),
        ({"spacing_mm": 1.0, "compounding": "latest"}, "linear' with 'latest"),
        ({"spacing_mm": 1.0, "clip_origin_px": (0, 0)}, "both or neither"),
    ],
)
def test_settings_are_checked(settings: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        VolumePlacement(**settings)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("sequence", "device_set", "volume", "clip", "interpolation", "covered", "correlation"),
    [
        ("SpinePhantomFreehand", "SpinePhantomFreehandReconstructionOnly", "SpinePhantomFreehandReconstructed",
         None, "linear", 0.76, 0.99),
        ("SpinePhantomFreehand", "SpinePhantomFreehandReconstructionOnly", "vtkVolumeReconstructorTestNNLATEvolumeRef",
         ((192, 16), (420, 576)), "nearest", 0.99, 0.99),
        ("NwirePhantomFreehand", "NwirePhantomFreehand_vtkVolumeReconstructorTest2",
         "NwirePhantomFreehandReconstructed", ((167, 62), (495, 488)), "nearest", 0.8, 0.95),
    ],
)  # fmt: skip
def test_reconstructions_of_plus(
    real_data: Path,
    sequence: str,
    device_set: str,
    volume: str,
    clip: tuple[tuple[int, int], tuple[int, int]] | None,
    interpolation: str,
    covered: float,
    correlation: float,
) -> None:
    sitk = pytest.importorskip("SimpleITK")
    plus = real_data / "plus"
    reader = PlusReader(device_set=str(plus / f"PlusDeviceSet_{device_set}.xml"))
    sweep = reader(plus / f"{sequence}.igs.mha")
    posed = synchronise(sweep, max_gap_s=1.0)
    reference = sitk.ReadImage(str(plus / f"{volume}.mha"))
    origin_px, size_px = clip or (None, None)
    latest = "NNLATE" in volume
    placement = VolumePlacement(0.5, interpolation, "latest" if latest else "mean", origin_px, size_px)
    own = placement.grid(posed.world_A_pixel, *sweep.images.shape[1:])
    np.testing.assert_allclose(own.origin_mm, reference.GetOrigin(), atol=1e-3)
    # Newer versions of PLUS count the last voxel in, older ones did not.
    np.testing.assert_array_equal(np.array(own.size) + latest, reference.GetSize())
    grid = VolumeGrid(np.array(reference.GetOrigin()), 0.5, reference.GetSize())
    agreement = compare(placement(sweep.images, posed.world_A_pixel, grid), sitk.GetArrayFromImage(reference))
    assert agreement.reference_covered > covered
    assert agreement.correlation > correlation
    if latest:
        assert agreement.same_share > 0.85
