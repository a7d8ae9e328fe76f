"""The chain keeps count of what each filter takes, times each stage, and stops where it is told to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tube_sweeps import tube_sweep

from registration.errors import InputError
from registration.pipeline import STAGES, Reconstruction
from registration.reconstruction.contours import ContourExtractor
from registration.reconstruction.mask_outliers import MaskOutliers
from registration.reconstruction.outlier_filters import RadiusOutlierRemoval, VoxelDownsampling
from registration.reconstruction.surface import PoissonSurface
from registration.reconstruction.taubin import TaubinSmoothing
from registration.synchronisation import synchronise

CHAIN = Reconstruction(
    ContourExtractor(),
    {"voxel": VoxelDownsampling(0.5), "radius": RadiusOutlierRemoval(2.0, 8)},
    PoissonSurface(cell_mm=0.8, bridge_mm=3.0),
    TaubinSmoothing(),
)


def test_a_speck_is_counted_by_the_filter_that_takes_it() -> None:
    tube = tube_sweep(count=21)
    tube.masks[10, 2:6, 2:6] = True
    poses = synchronise(tube.sweep, 0.1).world_A_pixel
    told: list[str] = []
    found = replace(CHAIN, mask_outliers=MaskOutliers(enabled=False))(tube.masks, poses, told.append)
    assert len(found.contours) == len(found.cloud) + sum(found.removed.values())
    # The speck's contour: a few points in a cube or two, 6 mm from the tube.
    assert 1 <= found.removed["radius"] <= 12
    assert tube.off_axis_mm(found.cloud.points_mm).max() < 4.2
    assert found.removed["voxel"] > 0.3 * len(found.contours)
    assert found.centerline is None
    assert found.refusal == "none was asked for"
    assert tuple(found.seconds) == STAGES[:-1]
    assert [text.split()[0] for text in told] == ["contours", "surface"]
    assert found.surface is found.smoothed.mesh
    assert len(found.rough.triangles) == len(found.surface.triangles)


def test_a_speck_is_taken_out_of_its_mask_before() -> None:
    tube = tube_sweep(count=21)
    clean = CHAIN(tube.masks, synchronise(tube.sweep, 0.1).world_A_pixel)
    tube.masks[10, 2:6, 2:6] = True
    found = CHAIN(tube.masks, synchronise(tube.sweep, 0.1).world_A_pixel)
    assert np.flatnonzero(found.checked.specks).tolist() == [10]
    assert not found.checked.rejected.any()
    np.testing.assert_array_equal(found.cloud.points_mm, clean.cloud.points_mm)
    # The masks of the caller stay as they were.
    assert tube.masks[10, 2:6, 2:6].all()


def test_empty_masks_and_what_is_no_filter_are_refused() -> None:
    tube = tube_sweep(count=5)
    poses = synchronise(tube.sweep, 0.1).world_A_pixel
    with pytest.raises(InputError, match="masks: expected a vessel in some of them, received 5 without any"):
        CHAIN(np.zeros_like(tube.masks), poses)
    # Past the type checker of the tests, as a configuration without ``_target_`` comes.
    unchecked = object.__new__(Reconstruction)
    object.__setattr__(unchecked, "filters", {"voxel": 0.5})
    with pytest.raises(InputError, match="filters: expected filters by name"):
        unchecked.__post_init__()
    # A filter that takes all leaves nothing to make a surface of.
    greedy = Reconstruction(
        CHAIN.contours, {"radius": RadiusOutlierRemoval(0.01, 8)}, CHAIN.surface, CHAIN.smoothing
    )
    with pytest.raises(InputError, match="cloud: expected at least 10 points, received 0"):
        greedy(tube.masks, poses)
