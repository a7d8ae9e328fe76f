"""Distances and pose errors with answers worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from vessels import bent_tube

from registration import transforms
from registration.errors import InputError
from registration.geometry.shapes import Mesh
from registration.metrics.surface_distance import (
    SurfaceDistance,
    SurfaceResiduals,
    pose_error,
    rms,
    surface_residuals,
    trimmed_rms,
)

TRIANGLE = Mesh(np.array([[0.0, 0, 0], [4, 0, 0], [0, 4, 0]]), np.array([[0, 1, 2]]))


def rectangle(length_mm: float, height_mm: float = 0.0) -> Mesh:
    corners = np.array([[0.0, 0, 0], [length_mm, 0, 0], [length_mm, 10, 0], [0, 10, 0]])
    return Mesh(corners + np.array([0, 0, height_mm]), np.array([[0, 1, 2], [0, 2, 3]]))


@pytest.mark.parametrize("away_mm", [0.0, 1e4])
def test_distance_to_face_edge_and_corner(away_mm: float) -> None:
    surface = Mesh(TRIANGLE.vertices_mm + away_mm, TRIANGLE.triangles)
    points = np.array([[1.0, 1, 3], [2, -2, 0], [-3, -4, 0], [3, 3, 0], [1, 2, 0]])
    expected = [3, 2, 5, np.sqrt(2), 0]
    np.testing.assert_allclose(SurfaceDistance(surface)(points + away_mm), expected, atol=1e-5)


def test_distance_to_points_where_there_are_no_triangles() -> None:
    np.testing.assert_allclose(SurfaceDistance(TRIANGLE.vertices_mm)(np.array([[1.0, 1, 0]])), [np.sqrt(2)])


def test_stray_vertices_do_not_cost_precision() -> None:
    stray = Mesh(np.concatenate([TRIANGLE.vertices_mm, [[1e7, 1e7, 1e7]]]), TRIANGLE.triangles)
    np.testing.assert_allclose(SurfaceDistance(stray)(np.array([[1.0, 1, 0.001]])), [0.001], atol=1e-6)


def test_distances_refuse_what_has_none() -> None:
    with pytest.raises(InputError, match=r"^surface: expected a mesh with triangles, received none$"):
        SurfaceDistance(Mesh(np.eye(3), np.empty((0, 3), dtype=np.int64)))
    with pytest.raises(InputError, match="surface: expected at least 3 points"):
        SurfaceDistance(np.empty((0, 3)))
    with pytest.raises(
        InputError, match=r"^points_mm: expected finite coordinates, received NaN or infinity$"
    ):
        SurfaceDistance(TRIANGLE)(np.array([[0.0, np.nan, 0]]))


def test_residuals_of_a_half_covered_rectangle() -> None:
    """A 10 mm square 1 mm above a 20 mm by 10 mm rectangle; beyond the square the way back is sqrt(1 + d^2)."""
    found = surface_residuals(
        rectangle(10),
        rectangle(20),
        transforms.translation((0, 0, 1)),
        inlier_mm=1.5,
        keep=0.5,
        samples=40_000,
    )
    back_squared = 0.5 * 1 + 0.5 * (1 + 100 / 3)
    far = (np.sqrt(101) * 10 + np.arcsinh(10)) / 2 / 10
    assert found.rmse_mm == pytest.approx(1, abs=1e-4)
    assert found.rmse_trimmed_mm == pytest.approx(1, abs=1e-4)
    assert found.rmse_bidirectional_mm == pytest.approx(np.sqrt(0.5 * (1 + back_squared)), rel=0.01)
    assert found.msd_mm == pytest.approx(0.5 * (1 + 0.5 * (1 + far)), rel=0.01)
    assert found.hd95_mm == pytest.approx(np.sqrt(1 + 9**2), rel=0.01)
    assert found.inlier_share == 1
    assert found.coverage == pytest.approx(0.5 + np.sqrt(1.25) / 20, abs=0.01)


def test_residuals_are_from_moving_to_fixed() -> None:
    found = surface_residuals(
        rectangle(20), rectangle(10), np.eye(4), inlier_mm=1.0, keep=1.0, samples=40_000
    )
    assert found.rmse_mm == pytest.approx(np.sqrt(0.5 * 100 / 3), rel=0.01)
    assert found.hd95_mm == pytest.approx(9, abs=0.1)
    assert found.inlier_share == pytest.approx(0.55, abs=0.01)
    assert found.coverage == 1


def test_residuals_of_a_shift_along_the_normal_are_the_shift_both_ways() -> None:
    found = surface_residuals(
        rectangle(10), rectangle(10), transforms.translation((0, 0, 2)), inlier_mm=2.0, keep=0.5, samples=1
    )
    assert found.rmse_mm == found.rmse_trimmed_mm == found.rmse_bidirectional_mm == 2
    assert found.msd_mm == found.hd95_mm == 2
    assert (found.inlier_share, found.coverage) == (1, 1)  # at the inlier distance itself


def test_the_seed_decides_which_points_are_measured() -> None:
    def at(**settings: int) -> SurfaceResiduals:
        return surface_residuals(rectangle(20), rectangle(10), np.eye(4), inlier_mm=1.0, keep=0.9, **settings)

    assert at() == at(seed=0, samples=10_000)
    assert at(seed=3) == at(seed=3) != at(seed=4)


def test_residuals_do_not_depend_on_the_density_of_the_mesh() -> None:
    coarse = rectangle(10)
    fine = np.stack(np.meshgrid(np.linspace(0, 10, 21), np.linspace(0, 10, 21), [0.0]), axis=-1).reshape(
        -1, 3
    )
    settings = {"inlier_mm": 1.0, "keep": 1.0}
    to_mesh = surface_residuals(fine, coarse, transforms.translation((0, 0, 0.1)), **settings)
    to_points = surface_residuals(coarse, fine, transforms.translation((0, 0, 0.1)), **settings)
    assert to_mesh.rmse_mm == pytest.approx(0.1, abs=1e-5)
    # Half a millimetre apart, the points add what the triangles do not.
    assert to_points.rmse_mm > 0.2


def test_residuals_follow_an_oblique_pose() -> None:
    mesh = bent_tube()
    pose = transforms.from_rotation(Rotation.from_rotvec([1.0, -2.0, 0.5]), np.array([300.0, -20, 5]))
    moved = Mesh(transforms.apply(transforms.invert_rigid(pose), mesh.vertices_mm), mesh.triangles)
    found = surface_residuals(moved, mesh, pose, inlier_mm=0.1, keep=1.0)
    assert found.hd95_mm < 1e-4
    assert (found.inlier_share, found.coverage) == (1, 1)
    assert surface_residuals(moved, mesh, np.eye(4), inlier_mm=0.1, keep=1.0).rmse_mm > 10


@pytest.mark.parametrize(
    "change, message",
    [
        ({"inlier_mm": 0.0}, "inlier_mm: expected a number above 0"),
        ({"keep": 1.1}, "keep: expected a number above 0 and at most 1"),
        ({"samples": 0}, "samples: expected a whole number"),
        ({"fixed_T_moving": np.diag([1.0, 1, -1, 1])}, "fixed_T_moving: expected a right-handed"),
    ],
)
def test_residuals_refuse_wrong_settings(change: dict[str, object], message: str) -> None:
    settings = {"inlier_mm": 1.0, "keep": 0.9, "fixed_T_moving": np.eye(4)} | change
    with pytest.raises(InputError, match=message):
        surface_residuals(rectangle(10), rectangle(20), **settings)


def test_pose_error_of_a_translation() -> None:
    truth = transforms.from_rotation(Rotation.from_rotvec([0.3, 2.0, -1.0]), np.array([100.0, 200, -50]))
    estimate = transforms.compose(transforms.translation((0, 3, 4)), truth)
    error = pose_error(estimate, truth, np.random.default_rng(0).normal(size=(20, 3)) * 40)
    np.testing.assert_allclose(
        [error.tre_mm, error.tre_max_mm, error.rotation_error_deg, error.translation_error_mm],
        [5, 5, 0, 5],
        atol=1e-5,
    )


def test_pose_error_of_a_turn_about_the_targets() -> None:
    """A quarter turn about (10, 0, 0): targets at 1 and 2 mm from it move by sqrt(2) times as much."""
    truth = transforms.translation((7.0, 8.0, 9.0))
    turn = transforms.rotate_about(Rotation.from_rotvec([0, 0, np.pi / 2]), np.array([10.0, 0, 0]))
    targets = np.array([[11.0, 0, 0], [9, 0, 0], [10, 2, 0], [10, -2, 0]])
    error = pose_error(transforms.compose(turn, truth), truth, targets)
    assert error.tre_mm == pytest.approx(np.sqrt((2 + 2 + 8 + 8) / 4))
    assert error.tre_max_mm == pytest.approx(np.sqrt(8))
    assert error.rotation_error_deg == pytest.approx(90)
    assert error.translation_error_mm == pytest.approx(0, abs=1e-12)


def test_targets_lie_in_the_fixed_frame() -> None:
    """The truth turns by half about z at the origin; an estimate off by a turn about a fixed point leaves it alone."""
    truth = transforms.rotate_about(Rotation.from_rotvec([0, 0, np.pi]), np.zeros(3))
    point = np.array([[30.0, 0, 0]])
    off = transforms.rotate_about(Rotation.from_rotvec([0, 0, 0.2]), point[0])
    assert pose_error(transforms.compose(off, truth), truth, point).tre_mm == pytest.approx(0, abs=1e-9)
    assert pose_error(transforms.compose(off, truth), truth, -point).tre_mm > 10


def test_pose_errors_are_never_plausible_numbers_for_a_failure() -> None:
    broken = np.full((4, 4), np.nan)
    with pytest.raises(InputError, match="fixed_T_moving: expected finite"):
        pose_error(broken, np.eye(4), np.eye(3))
    with pytest.raises(InputError, match="true_fixed_T_moving: expected finite"):
        pose_error(np.eye(4), broken, np.eye(3))
    with pytest.raises(InputError, match="targets_mm: expected"):
        pose_error(np.eye(4), np.eye(4), np.empty((0, 3)))


def test_root_mean_squares_by_hand() -> None:
    distances = np.array([3.0, 1.0, 5.0, 1.0])
    assert rms(distances) == 3
    assert trimmed_rms(distances, 0.75) == pytest.approx(np.sqrt(11 / 3))
    assert trimmed_rms(np.array([3.0, 2.0, 5.0]), 0.01) == 2
    assert trimmed_rms(distances, 1.0) == 3
    with pytest.raises(InputError, match=r"^distances_mm: expected at least one distance, received none$"):
        rms(np.empty(0))
    with pytest.raises(InputError, match=r"^keep: expected a number above 0 and at most 1"):
        trimmed_rms(distances, 1.5)
