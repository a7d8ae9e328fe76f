"""Filters on points drawn by hand."""

from __future__ import annotations

import numpy as np
import pytest

from registration.errors import InputError
from registration.geometry.point_cloud import OrientedCloud
from registration.reconstruction.outlier_filters import (
    RadiusOutlierRemoval,
    StatisticalOutlierRemoval,
    VoxelDownsampling,
)


def cloud_of(points_mm: np.ndarray) -> OrientedCloud:
    """Each point's normal carries its number, to see which one stayed."""
    return OrientedCloud(points_mm, np.arange(len(points_mm))[:, None] * np.ones((1, 3)))


GRID_MM = np.stack(np.meshgrid(*[np.arange(6.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)


def test_the_point_nearest_to_the_mean_of_its_cube_stays() -> None:
    points_mm = np.array([[0.0, 0, 0], [0.3, 0, 0], [0.5, 0, 0], [1.2, 0, 0], [0, 0, 1.7]])
    found = VoxelDownsampling(1.0)(cloud_of(points_mm))
    assert found.removed.tolist() == [0, 2]
    np.testing.assert_array_equal(found.cloud.points_mm, points_mm[[1, 3, 4]])
    np.testing.assert_array_equal(found.cloud.normals[:, 0], [1, 3, 4])


def test_points_alone_are_left_out_by_both() -> None:
    points_mm = np.concatenate([GRID_MM, [[30.0, 0, 0], [-20, 5, 5]]])
    for filtered in (StatisticalOutlierRemoval(8, 3.0), RadiusOutlierRemoval(1.1, 3)):
        found = filtered(cloud_of(points_mm))
        assert found.removed.tolist() == [216, 217]
        np.testing.assert_array_equal(found.cloud.points_mm, GRID_MM)


def test_the_radius_counts_other_points_only() -> None:
    pair_mm = np.array([[0.0, 0, 0], [1, 0, 0], [9, 0, 0]])
    assert RadiusOutlierRemoval(1.5, 1)(cloud_of(pair_mm)).removed.tolist() == [2]
    assert RadiusOutlierRemoval(1.5, 2)(cloud_of(pair_mm)).removed.tolist() == [0, 1, 2]
    assert RadiusOutlierRemoval(1.5, 5)(cloud_of(pair_mm)).removed.tolist() == [0, 1, 2]


def test_few_points_and_none() -> None:
    nothing = cloud_of(np.empty((0, 3)))
    for filtered in (VoxelDownsampling(1.0), StatisticalOutlierRemoval(), RadiusOutlierRemoval(1.0)):
        found = filtered(nothing)
        assert (len(found.cloud), len(found.removed)) == (0, 0)
    assert len(StatisticalOutlierRemoval(16)(cloud_of(GRID_MM[:9])).removed) == 0


def test_bad_settings_and_points() -> None:
    for cls, setting in (
        (VoxelDownsampling, {"cell_mm": 0.0}),
        (StatisticalOutlierRemoval, {"neighbours": 0}),
        (StatisticalOutlierRemoval, {"deviations": -1.0}),
        (RadiusOutlierRemoval, {"radius_mm": -1.0}),
        (RadiusOutlierRemoval, {"radius_mm": 1.0, "neighbours": 0}),
    ):
        with pytest.raises(InputError, match=list(setting)[-1]):
            cls(**setting)
    with pytest.raises(InputError, match="cloud: expected finite coordinates"):
        VoxelDownsampling(1.0)(cloud_of(np.array([[0.0, np.nan, 0]])))
