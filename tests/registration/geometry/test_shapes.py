"""Meshes, centerlines, principal frames and the refusal of clouds that are none."""

from __future__ import annotations

import numpy as np
import pytest
from vessels import bent_tube

from registration.errors import InputError
from registration.geometry.shapes import (
    Centerline,
    Mesh,
    Polyline,
    diagonal_mm,
    principal_frame,
    require_cloud,
    surface_frame,
    transformed,
)

# Two right triangles in oblique planes: 3-4-5 (area 6) and 6-8-10 (area 24).
TWO = Mesh(
    np.array([[0.0, 0, 0], [3, 0, 0], [0, 4, 0], [10, 0, 0], [10, 6, 0], [10, 0, 8]]),
    np.array([[0, 1, 2], [3, 4, 5]]),
)


def test_a_mesh_and_points_are_transformed_alike() -> None:
    quarter_turn = np.array([[0.0, -1, 0, 5], [1, 0, 0, 0], [0, 0, 1, -2], [0, 0, 0, 1]])
    moved = transformed(TWO, quarter_turn)
    assert isinstance(moved, Mesh)
    np.testing.assert_array_equal(moved.triangles, TWO.triangles)
    np.testing.assert_allclose(moved.vertices_mm[[1, 4]], [[5, 3, -2], [-1, 10, -2]])
    np.testing.assert_allclose(transformed(TWO.vertices_mm, quarter_turn), moved.vertices_mm)


def test_areas_by_hand() -> None:
    np.testing.assert_allclose(TWO.areas_mm2, [6, 24])


def test_sampling_is_uniform_by_area_and_stays_on_the_triangles() -> None:
    points = TWO.sample(20_000, np.random.default_rng(0))
    first = points[:, 2] == 0
    first &= points[:, 0] <= 3
    # A fifth of the area; the standard error of the share is 0.003.
    assert first.mean() == pytest.approx(0.2, abs=0.012)
    assert (points[first, 0] / 3 + points[first, 1] / 4 <= 1 + 1e-12).all()
    np.testing.assert_allclose(points[~first, 0], 10)
    np.testing.assert_allclose(points[~first].mean(axis=0), [10, 2, 8 / 3], atol=0.1)


def test_a_mesh_without_area_cannot_be_sampled() -> None:
    flat = Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]]))
    with pytest.raises(InputError, match="mesh: expected a surface with area"):
        flat.sample(5, np.random.default_rng(0))


def test_a_mesh_refuses_wrong_indices_and_nan() -> None:
    with pytest.raises(InputError, match="triangles: expected indices from 0 to 2, received 0 to 3"):
        Mesh(np.eye(3), np.array([[0, 1, 3]]))
    with pytest.raises(InputError, match="vertices_mm: expected finite"):
        Mesh(np.full((3, 3), np.nan), np.array([[0, 1, 2]]))


def line(*points: tuple[float, float, float]) -> Polyline:
    return Polyline(np.array(points, dtype=float), np.ones(len(points)))


def test_arc_length_of_a_bent_line() -> None:
    bent = line((1, 1, 1), (4, 5, 1), (4, 5, 13))
    np.testing.assert_allclose(bent.arc_mm, [0, 5, 17])
    assert bent.length_mm == 17
    np.testing.assert_allclose(bent.at(np.array([2.5, 11.0])), [[2.5, 3, 1], [4, 5, 7]])


def test_even_points_are_evenly_spaced_with_both_ends() -> None:
    points = Centerline((line((0, 0, 0), (1, 0, 0), (10, 0, 0)),)).even_points(11)
    np.testing.assert_allclose(points, np.stack([np.arange(11.0), np.zeros(11), np.zeros(11)], axis=1))


def test_a_shared_trunk_is_sampled_once() -> None:
    left = line((0, 0, 0), (0, 0, 50), (30, 0, 90))
    right = line((0, 0, 0), (0, 0, 50), (-30, 0, 90))
    points = Centerline((left, right)).even_points(500)
    step = 200 / 498
    assert len(points) <= 500
    assert (points[:, 2] < 49).sum() == pytest.approx(49 / step, abs=2)
    apart = np.linalg.norm(points[:, None] - points[None], axis=2)
    assert apart[~np.eye(len(points), dtype=bool)].min() > 0.4 * step
    for end in ((0, 0, 0), (30, 0, 90), (-30, 0, 90)):
        assert np.linalg.norm(points - np.array(end), axis=1).min() < 1e-9


def test_centerlines_refuse_what_is_no_line() -> None:
    with pytest.raises(InputError, match="lines: expected at least one"):
        Centerline(())
    with pytest.raises(InputError, match="points_mm: expected at least 2 points"):
        line((0, 0, 0))
    with pytest.raises(InputError, match="points_mm: expected finite"):
        line((0, 0, 0), (0, 0, np.nan))
    with pytest.raises(InputError, match="radius_mm: expected finite radii"):
        Polyline(np.eye(3), np.array([1.0, -1.0, 1.0]))
    with pytest.raises(InputError, match="max_points: expected at least 2"):
        Centerline((line((0, 0, 0), (1, 0, 0)),)).even_points(1)


def test_principal_frame_of_an_oblique_cross() -> None:
    axes = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    arms = np.concatenate(
        [length * np.outer([1, -1], axes[:, k]) for k, length in enumerate((6.0, 3.0, 1.0))]
    )
    frame = principal_frame(arms + np.array([10.0, 20, 30]))
    np.testing.assert_allclose(frame.centre_mm, [10, 20, 30], atol=1e-12)
    np.testing.assert_allclose(np.abs(frame.axes.T @ axes), np.eye(3), atol=1e-12)
    # Two of six points lie at each distance.
    np.testing.assert_allclose(frame.spread_mm, np.array([6.0, 3.0, 1.0]) / np.sqrt(3))
    assert np.linalg.det(frame.axes) == pytest.approx(1)
    for axis in frame.axes.T[:2]:
        assert axis[np.abs(axis).argmax()] > 0


def test_weights_stand_for_repeated_points() -> None:
    points = np.random.default_rng(4).normal(size=(5, 3))
    counts = np.array([1, 3, 2, 1, 4])
    weighted, repeated = (
        principal_frame(points, counts.astype(float)),
        principal_frame(points.repeat(counts, axis=0)),
    )
    np.testing.assert_allclose(weighted.axes, repeated.axes, atol=1e-12)
    np.testing.assert_allclose(weighted.spread_mm, repeated.spread_mm)


def test_surface_frame_weighs_by_area_and_not_by_vertices() -> None:
    mesh = bent_tube()
    dense = principal_frame(mesh.sample(200_000, np.random.default_rng(0)))
    exact = surface_frame(mesh)
    np.testing.assert_allclose(exact.centre_mm, dense.centre_mm, atol=0.1)
    np.testing.assert_allclose(exact.spread_mm, dense.spread_mm, rtol=0.01)
    np.testing.assert_allclose(exact.axes, dense.axes, atol=0.02)
    assert np.linalg.norm(mesh.vertices_mm.mean(axis=0) - exact.centre_mm) > 1


@pytest.mark.parametrize(
    "points, message",
    [
        (np.empty((0, 3)), "moving_mm: expected at least 3 points, received 0"),
        (np.eye(3)[:2], "moving_mm: expected at least 3 points, received 2"),
        (np.array([[0.0, 0, 0], [1, np.nan, 0], [0, 1, 0]]), "received 1 points with NaN or infinity"),
        (np.array([[0.0, 0, 0], [1, np.inf, 0], [0, 1, 0]]), "received 1 points with NaN or infinity"),
        (np.full((7, 3), 2.5), "received 7 equal points"),
        (np.outer(np.arange(9.0), [1, -2, 3]) + 100, "received points on one line"),
    ],
)
def test_clouds_that_are_none_are_refused(points: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        require_cloud(points, "moving_mm")


def test_a_thin_plate_far_from_the_origin_is_a_cloud() -> None:
    plate = np.array([[0.0, 0, 0], [100, 0, 0], [0, 0.1, 0]]) + 1e4
    np.testing.assert_array_equal(require_cloud(plate, "m"), plate)


def test_diagonal_of_the_bounding_box() -> None:
    assert diagonal_mm(np.array([[1.0, 1, 1], [2, 3, 3], [1, 2, 2]])) == pytest.approx(3)
