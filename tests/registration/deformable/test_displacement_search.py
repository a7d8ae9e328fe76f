"""The displacement search: a smooth motion that is known, a lung with landmarks, and what it refuses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bench_lung import read_case

from registration.deformable.displacement_search import (
    STAGES,
    DisplacementSearch,
    DriftRefinement,
    moment_matched_affine,
)
from registration.errors import InputError

SIDE_MM = 150.0
BOX = np.random.default_rng(0).uniform(0.0, SIDE_MM, (300, 3))


def waves(points_mm: np.ndarray) -> np.ndarray:
    """A smooth displacement of up to 15 mm that no affine map comes near to."""
    return 15.0 / np.sqrt(3.0) * np.sin(2.0 * np.pi * points_mm[:, [1, 2, 0]] / SIDE_MM)


@pytest.fixture(scope="module")
def clouds() -> tuple[np.ndarray, np.ndarray]:
    """Two random 70 % of the same points, one before and one after the displacement."""
    rng = np.random.default_rng(1)
    points_mm = rng.uniform(0.0, SIDE_MM, (1500, 3))
    moving, fixed = (rng.permutation(len(points_mm))[:1050] for _ in range(2))
    return points_mm[moving], (points_mm + waves(points_mm))[fixed]


def test_a_smooth_displacement_is_found_where_no_point_was(clouds: tuple[np.ndarray, np.ndarray]) -> None:
    found = DisplacementSearch()(*clouds)
    held_out_mm = np.random.default_rng(2).uniform(10.0, SIDE_MM - 10.0, (500, 3))
    moved_mm = held_out_mm + waves(held_out_mm)
    matrix, offset_mm = moment_matched_affine(*clouds)
    affine_mm = held_out_mm @ matrix + offset_mm
    assert np.linalg.norm(affine_mm - moved_mm, axis=1).mean() > 3.0
    assert np.linalg.norm(held_out_mm + found(held_out_mm) - moved_mm, axis=1).mean() < 1.5


def test_the_same_clouds_give_the_same_displacement() -> None:
    search = DisplacementSearch(stages=STAGES[2:])
    first, again = (search(BOX, BOX + 0.3 * waves(BOX))(BOX) for _ in range(2))
    np.testing.assert_array_equal(first, again)


def test_the_affine_start_has_the_mean_and_covariance_of_the_fixed_cloud(
    clouds: tuple[np.ndarray, np.ndarray],
) -> None:
    moving_mm, fixed_mm = clouds
    matrix, offset_mm = moment_matched_affine(moving_mm, fixed_mm)
    started_mm = moving_mm @ matrix + offset_mm
    np.testing.assert_allclose(started_mm.mean(axis=0), fixed_mm.mean(axis=0))
    np.testing.assert_allclose(np.cov(started_mm.T), np.cov(fixed_mm.T))
    np.testing.assert_allclose(matrix, matrix.T)


def test_points_out_of_reach_of_all_others_stay() -> None:
    # Every second point of a lattice and the ones between: the affine start is none, and no point is near another one.
    lattice = np.stack(np.meshgrid(*3 * [np.arange(8.0)], indexing="ij"), axis=-1).reshape(-1, 3)
    odd = lattice.sum(axis=1) % 2 == 1
    search = DisplacementSearch(
        stages=(replace(STAGES[0], half_width_mm=4.0),),
        refinement=DriftRefinement(start_variance_mm2=0.1, min_variance_mm2=0.1),
    )
    found = search(30.0 * lattice[~odd], 30.0 * lattice[odd])
    np.testing.assert_allclose(found(BOX), 0.0, atol=1e-6)


def test_the_landmarks_of_a_lung(real_data: Path) -> None:
    case = read_case(real_data / "lung", 104)
    displacement = DisplacementSearch()(case.moving_mm, case.fixed_mm)
    assert case.error_mm(case.moving_landmarks_mm) > 15.0
    assert case.error_mm(case.moving_landmarks_mm + displacement(case.moving_landmarks_mm)) < 2.5


@pytest.mark.parametrize(
    ("moving_mm", "fixed_mm", "message"),
    [
        (BOX[:199], BOX, "moving_mm: expected at least 200 points, received 199"),
        (BOX, BOX[:199], "fixed_mm: expected at least 200 points, received 199"),
        (BOX, BOX * np.nan, "fixed_mm: expected finite coordinates"),
        (BOX * [1.0, 1.0, 0.0], BOX, "moving_mm: expected points that fill a volume"),
        (BOX, 10.0 * BOX, "fixed_mm: expected a cloud that 400000000 voxels of 1.5 mm hold"),
        # Coarse voxels alone would do.
        (BOX, 6.0 * BOX, "fixed_mm: expected a cloud that 400000000 voxels of 1 mm hold"),
    ],
)
def test_clouds_that_are_refused(moving_mm: np.ndarray, fixed_mm: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        DisplacementSearch()(moving_mm, fixed_mm)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("half_width_mm", 3.0),
        ("step_mm", 0.5),
        ("blur_mm", 13.0),
        ("patch_mm", 0.0),
        ("smoothing_mm", -1.0),
        ("couplings", ()),
        ("couplings", (0.1, 0.0)),
    ],
)
def test_stages_that_are_refused(name: str, value: object) -> None:
    with pytest.raises(InputError, match=f"^{name}: expected"):
        replace(STAGES[0], **{name: value})


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("beta_mm", 0.0),
        ("roughness_per_mm2", 0.0),
        ("outlier_weight", 0.0),
        ("outlier_weight", 1.0),
        ("start_variance_mm2", 0.0),
        ("min_variance_mm2", 0.0),
        ("iterations", 0),
        ("kernels", 0),
        ("neighbours", 1),
    ],
)
def test_refinements_that_are_refused(name: str, value: object) -> None:
    with pytest.raises(InputError, match=f"^{name}: expected"):
        DriftRefinement(**{name: value})


def test_a_search_without_stages_is_refused() -> None:
    with pytest.raises(InputError, match=r"^stages: expected at least one stage"):
        DisplacementSearch(stages=())
