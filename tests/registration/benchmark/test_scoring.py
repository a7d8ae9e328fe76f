"""Errors of answers that are wrong by a known amount."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from benchmark_cases import drawn_case, off_by
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.benchmark.scoring import PoseScore, lowest_tre_mm, roll_and_slide, score_pose
from registration.benchmark.symmetry import Screw, Symmetry
from registration.errors import InputError
from registration.geometry.shapes import principal_frame

CASE, TRUTH = drawn_case()


def test_the_true_pose_has_no_error_but_the_distance_of_its_points() -> None:
    score = score_pose(TRUTH.fixed_T_moving, TRUTH, CASE)
    assert score.tre_mm == pytest.approx(0, abs=1e-9)
    assert score.rotation_error_deg == pytest.approx(0, abs=1e-5)
    assert score.rmse_mm < 1e-3
    assert score.success and score.success_tre and score.success_tre_symmetric


def test_a_shift_is_an_error_of_its_length_everywhere() -> None:
    score = score_pose(off_by(TRUTH, (2.0, -1.0, 2.0)), TRUTH, CASE)
    for name in ("tre_mm", "tre_max_mm", "tre_covered_mm", "tre_uncovered_mm", "translation_error_mm"):
        assert getattr(score, name) == pytest.approx(3.0)
    assert score.tre_symmetric_mm == pytest.approx(3.0)
    assert 0 < score.rmse_mm < 3.0
    assert not score.success_tre


def test_covered_and_uncovered_targets_are_told_apart() -> None:
    # A turn about the first target leaves it in place: what is far from it errs most.
    first = TRUTH.targets_mm[0]
    turn = transforms.rotate_about(Rotation.from_rotvec([0.0, 0.0, np.deg2rad(10)]), first)
    score = score_pose(transforms.compose(turn, TRUTH.fixed_T_moving), TRUTH)
    assert score.tre_covered_mm < score.tre_mm < score.tre_uncovered_mm <= score.tre_max_mm
    assert np.isnan(score.rmse_mm)
    assert not score.success
    everything = replace(TRUTH, covered=np.ones_like(TRUTH.covered))
    assert np.isnan(score_pose(TRUTH.fixed_T_moving, everything).tre_uncovered_mm)


def test_roll_and_slide_are_about_and_along_the_longest_axis() -> None:
    targets_mm = np.outer(np.linspace(0, 50, 40), [0.0, 1.0, 0.0]) + np.array([3.0, 0.0, 7.0])
    axis = principal_frame(targets_mm).axes[:, 0]
    rolled = transforms.rotate_about(Rotation.from_rotvec(np.deg2rad(35) * axis), targets_mm[5])
    moved = transforms.compose(transforms.translation(tuple(-4.0 * axis)), rolled)
    assert roll_and_slide(moved, np.eye(4), targets_mm) == pytest.approx((35.0, 4.0))
    across = transforms.rotate_about(Rotation.from_rotvec([np.pi, 0.0, 0.0]), targets_mm.mean(axis=0))
    assert roll_and_slide(across, np.eye(4), targets_mm) == pytest.approx((0.0, 0.0), abs=1e-6)
    over = transforms.rotate_about(Rotation.from_rotvec(np.pi * axis), targets_mm[0])
    assert roll_and_slide(over, np.eye(4), targets_mm)[0] == pytest.approx(180.0)


def test_outliers_do_not_count_in_the_residual() -> None:
    stray = CASE.moving_mm.copy()
    stray[:10] += 100.0
    outlier = np.arange(300) < 10
    score = score_pose(TRUTH.fixed_T_moving, replace(TRUTH, outlier=outlier), replace(CASE, moving_mm=stray))
    assert score.rmse_mm < 1e-3


def test_a_symmetric_vessel_is_scored_up_to_its_symmetry_too() -> None:
    slide = Symmetry((Screw(np.zeros(3), np.array([0.0, 1.0, 0.0]), 0.0, 1.0, -20.0, 20.0),))
    truth = replace(TRUTH, symmetry=slide)
    score = score_pose(off_by(truth, (0.0, 12.0, 1.0)), truth)
    assert score.tre_mm == pytest.approx(np.sqrt(145))
    assert score.tre_symmetric_mm == pytest.approx(1.0, abs=1e-4)
    assert not score.success_tre
    assert score.success_tre_symmetric


def test_no_answer_is_infinitely_wrong() -> None:
    score = PoseScore()
    assert np.isinf(list(vars(score).values())).all()
    assert not (score.success or score.success_tre or score.success_tre_symmetric)


def test_what_is_no_pose_or_another_case_is_refused() -> None:
    with pytest.raises(InputError, match="fixed_T_moving"):
        score_pose(2 * np.eye(4), TRUTH)
    with pytest.raises(InputError, match="case: expected 200 moving points as the truth of tube_whole says"):
        score_pose(np.eye(4), replace(TRUTH, outlier=np.zeros(200, dtype=bool)), CASE)


def test_where_tissue_deforms_a_target_is_off_by_what_its_material_is() -> None:
    """Half of the material lies 3 mm along x, half 3 mm against it: with a shift of 1 mm it is 4 and 2 mm off."""
    side = np.where(np.arange(len(TRUTH.targets_mm)) % 2 == 0, 3.0, -3.0)
    soft = replace(TRUTH, displacement_mm=np.outer(side, [1.0, 0.0, 0.0]), covered=side > 0)
    assert lowest_tre_mm(soft) == pytest.approx(3.0)
    assert score_pose(TRUTH.fixed_T_moving, soft).tre_mm == pytest.approx(3.0)
    score = score_pose(off_by(TRUTH, (1.0, 0.0, 0.0)), soft, CASE)
    assert score.tre_mm == score.tre_symmetric_mm == pytest.approx(np.sqrt((4**2 + 2**2) / 2))
    assert score.tre_max_mm == score.tre_covered_mm == pytest.approx(4.0)
    assert score.tre_uncovered_mm == pytest.approx(2.0)
    assert score.tre_rigid_mm == score.translation_error_mm == pytest.approx(1.0)
    assert not score.success_tre
    assert lowest_tre_mm(TRUTH) == 0.0
    assert score_pose(off_by(TRUTH, (1.0, 0.0, 0.0)), TRUTH).tre_rigid_mm == pytest.approx(1.0)


def test_against_another_vessel_there_is_a_residual_and_no_error() -> None:
    other = replace(TRUTH, same_vessel=False, fixed_T_moving=np.full((4, 4), np.nan))
    score = score_pose(TRUTH.fixed_T_moving, other, CASE)
    assert score.rmse_mm < 1e-3
    assert np.isnan([score.tre_mm, score.tre_symmetric_mm, score.tre_rigid_mm, score.slide_error_mm]).all()
    assert not score.success_tre and not score.success_tre_symmetric
    assert np.isnan(lowest_tre_mm(other))
    with pytest.raises(InputError, match="fixed_T_moving"):
        score_pose(2 * np.eye(4), other, CASE)
