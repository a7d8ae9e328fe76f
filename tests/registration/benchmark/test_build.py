"""Cases of the benchmark: what is promised of them holds, and the same spec gives the same numbers."""

from __future__ import annotations

import numpy as np
import pytest

from registration import transforms
from registration.benchmark.blocks import CaseSpec, specs
from registration.benchmark.build import build_case
from registration.benchmark.cases import BenchmarkCase, CaseTruth, digest
from registration.benchmark.scoring import lowest_tre_mm, score_pose
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


def named(block: str, kind: str) -> Made:
    return build_case(next(spec for spec in specs("development", block) if spec.kind == kind))


def test_a_model_of_another_vessel_or_a_mirror_image_has_no_true_pose() -> None:
    own, own_truth = named("wrong_vessel", "own_piece40_middle")
    mirror, mirror_truth = named("wrong_vessel", "mirror_piece40")
    other, other_truth = named("wrong_vessel", "other_piece40")
    assert own_truth.same_vessel and not mirror_truth.same_vessel and not other_truth.same_vessel
    assert np.isnan(mirror_truth.fixed_T_moving).all() and np.isnan(other_truth.fixed_T_moving).all()
    np.testing.assert_allclose(mirror.fixed.vertices_mm * [-1, 1, 1], own.fixed.vertices_mm)
    assert signed_volume_mm3(mirror.fixed) == pytest.approx(signed_volume_mm3(own.fixed))
    assert len(other.fixed.vertices_mm) != len(own.fixed.vertices_mm)
    # Targets run inside the model that the method is given.
    for case, truth in ((mirror, mirror_truth), (other, other_truth)):
        assert np.median(SurfaceDistance(case.fixed)(truth.targets_mm)) > 1.5
    placed_mm = transforms.apply(own_truth.fixed_T_moving, own.moving_mm)
    assert rms(SurfaceDistance(own.fixed)(placed_mm)) < 0.3


@pytest.mark.parametrize("kind, common", [("common50_started", 0.5), ("common60", 0.6)])
def test_neither_side_holds_the_other(kind: str, common: float) -> None:
    case, truth = named("overlap", kind)
    moved_z_mm = transforms.apply(truth.fixed_T_moving, case.moving_mm)[:, 2]
    fixed_z_mm = case.fixed.vertices_mm[:, 2]
    low_mm = max(moved_z_mm.min(), fixed_z_mm.min())
    high_mm = min(moved_z_mm.max(), fixed_z_mm.max())
    for z_mm in (moved_z_mm, fixed_z_mm):
        assert (high_mm - low_mm) / (z_mm.max() - z_mm.min()) == pytest.approx(common, abs=0.06)
        assert z_mm.min() < low_mm - 10 or z_mm.max() > high_mm + 10
    # Centerlines are coarse, each in the frame of its own side and along it.
    assert case.moving_centerline_mm is not None and case.fixed_centerline_mm is not None
    line_z_mm = transforms.apply(truth.fixed_T_moving, case.moving_centerline_mm)[:, 2]
    assert line_z_mm.min() > moved_z_mm.min() - 3 and line_z_mm.max() < moved_z_mm.max() + 3
    assert np.median(SurfaceDistance(case.fixed)(case.fixed_centerline_mm)) > 1
    assert (case.initial is not None) == kind.endswith("started")
    if case.initial is not None:
        assert 1 < score_pose(case.initial, truth).tre_mm < 15


def test_noise_is_that_of_the_kind_on_each_side() -> None:
    moving, moving_truth = named("noise", "moving_noise")
    both, both_truth = named("noise", "both_noise")
    for case, truth, fixed_mm in ((moving, moving_truth, 0.0), (both, both_truth, 1.0)):
        placed_mm = transforms.apply(truth.fixed_T_moving, case.moving_mm)
        # Across the wall alone: what a point's noise leaves of it to the nearest triangle.
        assert rms(SurfaceDistance(case.fixed)(placed_mm)) == pytest.approx(1.0, abs=0.2)
        assert rms(SurfaceDistance(case.fixed)(case.fixed_mm)) == pytest.approx(fixed_mm, abs=0.15)


def test_where_tissue_deforms_material_lies_where_the_truth_says() -> None:
    """Moved points, taken back by the true pose and the displacement nearest to them, lie on the model again."""
    case, truth = named("deforming", "field_large")
    assert truth.displacement_mm is not None
    placed_mm = transforms.apply(truth.fixed_T_moving, case.moving_mm)
    shown_mm = truth.targets_mm + truth.displacement_mm
    nearest = np.linalg.norm(placed_mm[:, None] - shown_mm[None], axis=2).argmin(axis=1)
    surface = SurfaceDistance(case.fixed)
    assert rms(surface(placed_mm - truth.displacement_mm[nearest])) < 0.6 * rms(surface(placed_mm))
    # The true pose is the best there is for the whole model's wall, so nearly so for its centerline.
    assert score_pose(truth.fixed_T_moving, truth).tre_mm == pytest.approx(lowest_tre_mm(truth))
    assert 1.0 < lowest_tre_mm(truth) < 4.0
    assert score_pose(truth.fixed_T_moving, truth).tre_rigid_mm == pytest.approx(0, abs=1e-9)
    for shift_mm in ((2.0, 0, 0), (0, -2.0, 0), (0, 0, 2.0)):
        off = transforms.compose(transforms.translation(shift_mm), truth.fixed_T_moving)
        assert score_pose(off, truth).tre_mm > lowest_tre_mm(truth)


def test_what_there_is_not_is_refused() -> None:
    with pytest.raises(InputError, match=r"kind: expected one of press_small, .* received 'whole'"):
        build_case(CaseSpec("random0100", 100, "whole", "deforming"))
    with pytest.raises(InputError, match="block: expected one of undeformed"):
        build_case(CaseSpec("random0100", 100, "whole", "soft"))
    with pytest.raises(InputError, match="model_seed: expected the anatomy whose model"):
        build_case(CaseSpec("random0100", 100, "other_piece40", "wrong_vessel"))
