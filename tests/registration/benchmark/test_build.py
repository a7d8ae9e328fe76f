"""Cases of the benchmark: what is promised of them holds, and the same spec gives the same numbers."""

from __future__ import annotations

import numpy as np
import pytest

from registration import transforms
from registration.benchmark.build import CaseSpec, build_case, specs
from registration.benchmark.cases import BenchmarkCase, CaseTruth, digest
from registration.errors import InputError
from registration.metrics.surface_distance import SurfaceDistance, rms
from registration.phantom.shapes import signed_volume_mm3

Made = tuple[BenchmarkCase, CaseTruth]


@pytest.fixture(scope="module")
def outliers() -> Made:
    return build_case(CaseSpec("random0000", 0, "outliers"))


@pytest.fixture(scope="module")
def piece() -> Made:
    return build_case(CaseSpec("random0000", 0, "piece40_middle"))


def test_the_subsets_are_24_and_24_anatomies_and_the_symmetric_shapes() -> None:
    for subset, first in (("development", 0), ("test", 1000)):
        found = specs(subset)
        assert sorted({spec.seed for spec in found}) == list(range(first, first + 24))
        assert len(found) == 24 * 8 == len({spec.name for spec in found})
    symmetric = specs("symmetric")
    assert {spec.anatomy for spec in symmetric} == {"straight", "arc", "helix", "bulge", "cone", "fork"}
    with pytest.raises(InputError, match="subset: expected one of development, test, symmetric"):
        specs("training")


def test_in_the_true_pose_the_sweep_lies_on_the_model(outliers: Made) -> None:
    case, truth = outliers
    placed_mm = transforms.apply(truth.fixed_T_moving, case.moving_mm)
    away_mm = SurfaceDistance(case.fixed)(placed_mm)
    assert rms(away_mm[~truth.outlier]) < 0.3
    assert truth.outlier.sum() == 300
    assert np.median(away_mm[truth.outlier]) > 5
    # Pose noise and the CT leave a residual: the fixed model is not the mesh that was swept.
    assert rms(away_mm[~truth.outlier]) > 0.05


def test_counts_frames_and_normals(outliers: Made) -> None:
    case, truth = outliers
    assert case.moving_mm.shape == case.moving_normals.shape == (3000, 3)
    assert case.fixed_mm.shape == (5000, 3)
    assert set(np.unique(case.moving_frame)) <= set(range(200))
    assert len(np.unique(case.moving_frame)) > 190
    np.testing.assert_allclose(np.linalg.norm(case.moving_normals, axis=1), 1, atol=1e-9)
    # In the true pose normals point out of the closed model: a step along them leads away from the centerline.
    placed_mm = transforms.apply(truth.fixed_T_moving, case.moving_mm[~truth.outlier])
    normals = case.moving_normals[~truth.outlier] @ truth.fixed_T_moving[:3, :3].T

    def from_line(points_mm: np.ndarray) -> np.ndarray:
        return np.linalg.norm(points_mm[:, None] - truth.targets_mm[None], axis=2).min(axis=1)

    assert (from_line(placed_mm + normals) > from_line(placed_mm)).mean() > 0.97
    assert signed_volume_mm3(case.fixed) > 0


def test_the_fixed_points_lie_on_the_fixed_mesh(outliers: Made) -> None:
    assert SurfaceDistance(outliers[0].fixed)(outliers[0].fixed_mm).max() < 1e-3


def test_the_targets_run_inside_the_model(outliers: Made) -> None:
    case, truth = outliers
    assert 300 < len(truth.targets_mm) <= 500
    depth_mm = SurfaceDistance(case.fixed)(truth.targets_mm)
    assert np.median(depth_mm) > 1.5
    z_mm = case.fixed.vertices_mm[:, 2]
    assert truth.targets_mm[:, 2].min() >= z_mm.min()
    assert truth.targets_mm[:, 2].max() <= z_mm.max()
    assert truth.covered.mean() > 0.95


def test_a_piece_shows_its_share_of_the_frames(piece: Made, outliers: Made) -> None:
    case, truth = piece
    shown = np.unique(case.moving_frame)
    assert (shown.min(), shown.max()) == (60, 139)
    assert truth.place == "middle"
    assert 0.2 < truth.covered.mean() < 0.6
    # What was swept is what is near: covered targets have points beside them, others far fewer.
    placed_mm = transforms.apply(truth.fixed_T_moving, case.moving_mm)
    near_mm = np.linalg.norm(placed_mm[:, None] - truth.targets_mm[None], axis=2).min(axis=0)
    assert np.median(near_mm[truth.covered]) < 0.5 * np.median(near_mm[~truth.covered])
    np.testing.assert_allclose(truth.targets_mm, outliers[1].targets_mm, atol=1e-9)


def test_the_same_spec_gives_the_same_case(piece: Made) -> None:
    """That it is the frozen one is tested where cases are made, with the same kernels on every processor."""
    assert digest(*piece) == digest(*build_case(CaseSpec("random0000", 0, "piece40_middle")))


def test_a_symmetric_case_knows_its_other_right_poses() -> None:
    spec = next(spec for spec in specs("symmetric") if spec.name == "straight_piece40_end")
    case, truth = build_case(spec)
    roll, slide = truth.symmetry.screws
    surface = SurfaceDistance(case.fixed)
    right_mm = rms(surface(transforms.apply(truth.fixed_T_moving, case.moving_mm)))
    for motion in (
        roll(np.array([0.3]))[0],
        slide(np.array([0.5 * (slide.low + slide.high)]))[0],
        slide(np.array([slide.low]))[0],
        truth.symmetry.flips[0],
    ):
        pose = transforms.compose(motion, truth.fixed_T_moving)
        assert rms(surface(transforms.apply(pose, case.moving_mm))) < right_mm + 0.1
    # One step beyond either end it leaves the model.
    beyond = transforms.compose(
        transforms.translation((0.0, 0.0, slide.low - 6 if slide.low < -6 else slide.high + 6)),
        truth.fixed_T_moving,
    )
    assert rms(surface(transforms.apply(beyond, case.moving_mm))) > right_mm + 0.5
