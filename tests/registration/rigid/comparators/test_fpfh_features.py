"""Features do not depend on how a cloud lies, and tell places of a vessel apart."""

from __future__ import annotations

import numpy as np
import pytest
from turned import FIXED, moved_by

from registration import transforms
from registration.errors import InputError
from registration.rigid.comparators import FpfhFeatures

FEATURES = FpfhFeatures(voxel_mm=2.0, radius_mm=12.0)


def test_a_turned_cloud_has_the_same_features() -> None:
    """Without thinning, whose voxels are laid along the axes, every point keeps its histogram but for rounding."""
    points = FIXED[::5]
    pose = moved_by(140.0, 30.0, 4)[1]
    every = FpfhFeatures(voxel_mm=1e-6, radius_mm=12.0)
    one, other = (
        np.asarray(every(cloud - cloud.mean(axis=0), "cloud")[1].data)
        for cloud in (points, transforms.apply(pose, points))
    )
    assert one.shape == (33, len(points))
    # Thinning puts points in an order of its own: each histogram is compared with the one nearest to it.
    apart = np.linalg.norm(one[:, :, None] - other[:, None, :], axis=0).min(axis=1)
    between = np.linalg.norm(one[:, :, None] - one[:, None, :], axis=0)[~np.eye(len(points), dtype=bool)]
    assert np.median(apart) < 1e-2 * np.median(between)


def test_the_thinned_cloud_is_spaced_by_the_voxel_and_faces_outwards() -> None:
    cloud, feature = FEATURES(FIXED, "fixed_mm")
    points, normals = np.asarray(cloud.points), np.asarray(cloud.normals)
    assert 200 < len(points) < len(FIXED) / 3
    assert feature.num() == len(points)
    assert np.einsum("pi,pi->", points - points.mean(axis=0), normals) > 0


@pytest.mark.parametrize(
    "settings",
    [
        {"voxel_mm": 0.0, "radius_mm": 3.0},
        {"radius_mm": -1.0, "voxel_mm": 1.0},
        {"radius_mm": 1.0, "voxel_mm": 1.0},
        {"neighbours": 2, "voxel_mm": 1.0, "radius_mm": 3.0},
        {"normal_neighbours": 2, "voxel_mm": 1.0, "radius_mm": 3.0},
    ],
)
def test_settings_out_of_range_are_refused(settings: dict[str, float]) -> None:
    with pytest.raises(InputError, match=f"{next(iter(settings))}: expected"):
        FpfhFeatures(**settings)


def test_a_cloud_smaller_than_its_voxels_is_refused_by_name() -> None:
    with pytest.raises(InputError, match="moving_mm: expected at least 10 points a voxel of 100 mm apart"):
        FpfhFeatures(voxel_mm=100.0, radius_mm=200.0)(FIXED, "moving_mm")
