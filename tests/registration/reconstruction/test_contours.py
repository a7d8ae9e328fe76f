"""Contours of drawn masks: place, side, frames, borders."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.errors import InputError
from registration.reconstruction.contours import ContourExtractor

ROWS, COLUMNS = np.mgrid[:90, :120].astype(float)


def disc(column: float, row: float, radius: float) -> np.ndarray:
    return np.hypot(COLUMNS - column, ROWS - row) < radius


def placed(angles_deg: tuple, shift_mm: tuple, pixel: np.ndarray) -> np.ndarray:
    rotation = Rotation.from_euler("xyz", angles_deg, degrees=True)
    return transforms.from_rotation(rotation, np.array(shift_mm, dtype=float)) @ pixel


def test_disc_in_an_oblique_anisotropic_frame() -> None:
    scale = np.diag([0.3, 0.2, 1.0, 1.0])
    world_A_pixel = placed((30, -50, 70), (100, -20, 5), scale)
    cloud = ContourExtractor()(disc(50.3, 40.4, 25.2)[None], world_A_pixel[None])
    centre_mm = transforms.apply(world_A_pixel, np.array([50.3, 40.4, 0.0]))
    local_mm = (cloud.points_mm - centre_mm) @ world_A_pixel[:3, :3] / np.array([0.3, 0.2, 1.0])
    np.testing.assert_allclose(local_mm[:, 2], 0, atol=1e-9)
    radius_px = np.hypot(local_mm[:, 0] / 0.3, local_mm[:, 1] / 0.2)
    assert abs(radius_px.mean() - 25.2) < 0.1
    assert np.abs(radius_px - 25.2).max() < 0.45
    # In mm the disc is an ellipse: its normal is the gradient of its equation, not the radius.
    gradient = local_mm / np.array([0.3**2, 0.2**2, 1.0])
    expected = gradient / np.linalg.norm(gradient, axis=1, keepdims=True)
    normal = cloud.normals @ world_A_pixel[:3, :3] / np.array([0.3, 0.2, 1.0])
    assert np.einsum("ni,ni->n", normal, expected).min() > 0.97
    np.testing.assert_allclose(np.linalg.norm(cloud.normals, axis=1), 1.0)


@pytest.mark.parametrize(
    "pixel", [np.diag([0.2, 0.2, 1, 1.0]), np.diag([-0.2, 0.2, 1, 1.0]), np.diag([0.2, -0.2, -1, 1.0])]
)
def test_normals_point_out_whichever_way_the_axes_run(pixel: np.ndarray) -> None:
    world_A_pixel = placed((10, 20, 30), (1, 2, 3), pixel)
    cloud = ContourExtractor()(disc(60, 45, 20)[None], world_A_pixel[None])
    centre_mm = transforms.apply(world_A_pixel, np.array([60.0, 45.0, 0.0]))
    assert (np.einsum("ni,ni->n", cloud.points_mm - centre_mm, cloud.normals) > 0).all()


def test_sheared_axes_keep_normals_at_right_angles_to_the_border() -> None:
    pixel = np.eye(4)
    pixel[0, 1] = 0.5
    cloud = ContourExtractor()(disc(50.3, 45.4, 30.2)[None], pixel[None])
    centre_mm = transforms.apply(pixel, np.array([50.3, 45.4, 0.0]))
    # In pixels the border is a circle; gradients map by the inverse transpose.
    gradient = (cloud.points_mm - centre_mm) @ np.linalg.inv(pixel[:3, :3]).T @ np.linalg.inv(pixel[:3, :3])
    gradient /= np.linalg.norm(gradient, axis=1, keepdims=True)
    cosine = np.einsum("ni,ni->n", gradient, cloud.normals)
    assert cosine.min() > 0.98
    # Turning the tangent in pixels instead would be off by up to some 14 degrees.
    radial = cloud.points_mm - centre_mm
    radial /= np.linalg.norm(radial, axis=1, keepdims=True)
    assert np.einsum("ni,ni->n", radial, cloud.normals).min() < 0.95


def test_concave_shape_and_hole_have_normals_away_from_the_vessel() -> None:
    crescent = disc(60, 45, 30) & ~disc(75, 45, 22)
    ring = disc(60, 45, 30) & ~disc(60, 45, 12)
    for mask in (crescent, ring):
        cloud = ContourExtractor()(mask[None], np.eye(4)[None])
        outside = np.rint(cloud.points_mm + 2.5 * cloud.normals).astype(int)
        within = np.rint(cloud.points_mm - 2.5 * cloud.normals).astype(int)
        assert not mask[outside[:, 1], outside[:, 0]].mean() > 0.03
        assert mask[within[:, 1], within[:, 0]].mean() > 0.97


def test_probability_maps_give_the_border_below_a_pixel() -> None:
    distance_px = np.hypot(COLUMNS - 50.3, ROWS - 40.7) - 20.4
    probability = 1 / (1 + np.exp(distance_px / 1.5))
    cloud = ContourExtractor()(probability[None], np.eye(4)[None])
    radius_px = np.hypot(cloud.points_mm[:, 0] - 50.3, cloud.points_mm[:, 1] - 40.7)
    np.testing.assert_allclose(radius_px, 20.4, atol=0.03)


def test_each_point_takes_its_own_frame() -> None:
    masks = np.stack([disc(40, 40, 15), np.zeros_like(disc(0, 0, 1)), disc(70, 50, 10)])
    world_A_pixel = np.stack([transforms.translation((0, 0, 5.0 * index)) for index in range(3)])
    cloud = ContourExtractor()(masks, world_A_pixel)
    assert set(cloud.frame_index.tolist()) == {0, 2}
    np.testing.assert_allclose(cloud.points_mm[:, 2], 5.0 * cloud.frame_index)
    assert np.hypot(*(cloud.points_mm[cloud.frame_index == 2, :2] - [70, 50]).T).max() < 10.5


def test_vessel_cut_by_the_border_has_an_open_contour() -> None:
    mask = disc(0, 45, 25)
    cloud = ContourExtractor()(mask[None], np.eye(4)[None])
    assert len(cloud.points_mm) > 40
    assert cloud.points_mm[:, 0].min() > 0
    np.testing.assert_allclose(np.hypot(cloud.points_mm[:, 0], cloud.points_mm[:, 1] - 45), 25, atol=0.8)
    assert (np.einsum("ni,ni->n", cloud.points_mm - [0, 45, 0], cloud.normals) > 0).all()


def test_closed_contours_name_no_point_twice() -> None:
    cloud = ContourExtractor()(disc(50, 40, 12)[None], np.eye(4)[None])
    assert len(np.unique(cloud.points_mm, axis=0)) == len(cloud.points_mm)


def test_nothing_gives_an_empty_cloud_and_specks_are_left_out() -> None:
    empty = ContourExtractor()(np.zeros((2, 20, 20), dtype=bool), np.stack([np.eye(4)] * 2))
    assert empty.points_mm.shape == (0, 3)
    speck = np.zeros((1, 20, 20), dtype=bool)
    speck[0, 10, 10] = True
    assert len(ContourExtractor(smoothing_px=0.0)(speck, np.eye(4)[None]).points_mm) == 0


def test_bad_input_is_named() -> None:
    with pytest.raises(InputError, match="world_A_pixel: expected one transform"):
        ContourExtractor()(np.zeros((2, 5, 5), dtype=bool), np.eye(4)[None])
    for setting in ({"level": 1.0}, {"smoothing_px": -1.0}, {"min_points": 2}):
        with pytest.raises(InputError, match=next(iter(setting))):
            ContourExtractor(**setting)


def test_several_vessels_and_cut_ones_are_told_apart() -> None:
    mask = disc(30, 45, 12) | disc(75, 45, 15) | disc(119, 20, 14)
    world_A_pixel = np.stack([np.eye(4), transforms.translation((0, 0, 2.0))])
    cloud = ContourExtractor()(np.stack([mask, disc(60, 40, 9)]), world_A_pixel)
    assert len(np.unique(cloud.contour_index)) == 4
    assert len(np.unique(cloud.contour_index[cloud.frame_index == 0])) == 3
    for contour in np.unique(cloud.contour_index):
        own = cloud.contour_index == contour
        assert len(np.unique(cloud.frame_index[own])) == 1
        at_edge = cloud.points_mm[own, 0].max() > 110
        assert (cloud.is_open[own] == at_edge).all()
    assert cloud.is_open.any()
    np.testing.assert_array_equal(cloud.world_A_pixel, world_A_pixel)
    assert len(cloud) == len(cloud.points_mm) == len(cloud.confidence)


def test_confidence_is_the_fall_of_the_probability_across_the_contour() -> None:
    distance_px = np.hypot(COLUMNS - 60, ROWS - 45) - 20
    # A sigmoid of scale s falls by tanh(2 / (2 s)) from two pixels inside to two outside.
    for scale_px in (0.7, 2.0, 5.0):
        probability = 1 / (1 + np.exp(distance_px / scale_px))
        cloud = ContourExtractor()(probability[None], np.eye(4)[None])
        np.testing.assert_allclose(cloud.confidence, np.tanh(1 / scale_px), atol=0.03)
    masks = (distance_px < 0)[None]
    assert (ContourExtractor()(masks, np.eye(4)[None]).confidence == 1).all()
