"""A deformable method's entry: the displacement goes from the model to where it was swept, after the method's pose."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import SimpleITK
from benchmark_cases import off_by
from deforming_cases import deforming_case, sway

from registration.benchmark.deformable_entries import score_displacement, write_entry
from registration.benchmark.scoring import material_error_mm
from registration.errors import InputError
from registration.metrics.surface_distance import rms

CASE, TRUTH = deforming_case("tube_a", "a")
SHIFT_MM = (0.5, -1.0, 2.0)


def entered(folder: Path, displacement, pose=TRUTH.fixed_T_moving) -> Path:
    write_entry(folder, "tube_a", pose, displacement, CASE.fixed_mm)
    return folder / "tube_a_displacement.nrrd"


def test_the_true_displacement_leaves_no_error(tmp_path: Path) -> None:
    found = score_displacement(entered(tmp_path, sway), TRUTH.fixed_T_moving, TRUTH)
    assert rms(material_error_mm(TRUTH.fixed_T_moving, TRUTH)) > 1.5
    assert found.tre_deformed_mm < 0.01  # linear between nodes 1.5 mm apart
    assert found.tre_deformed_covered_mm < 0.01 and found.tre_deformed_uncovered_mm < 0.01
    assert 0.6 < found.jacobian_min < 1.0


def test_a_displacement_may_undo_what_its_own_pose_is_off(tmp_path: Path) -> None:
    pose = off_by(TRUTH, SHIFT_MM)
    path = entered(tmp_path, lambda points_mm: sway(points_mm) + SHIFT_MM, pose)
    assert score_displacement(path, pose, TRUTH).tre_deformed_mm < 0.01
    assert score_displacement(path, TRUTH.fixed_T_moving, TRUTH).tre_deformed_mm == pytest.approx(
        np.linalg.norm(SHIFT_MM), abs=0.01
    )


def test_the_opposite_direction_doubles_the_error(tmp_path: Path) -> None:
    found = score_displacement(
        entered(tmp_path, lambda points_mm: -sway(points_mm)), TRUTH.fixed_T_moving, TRUTH
    )
    assert found.tre_deformed_mm == pytest.approx(
        2 * rms(material_error_mm(TRUTH.fixed_T_moving, TRUTH)), rel=0.01
    )


def test_no_displacement_is_the_rigid_error(tmp_path: Path) -> None:
    pose = off_by(TRUTH, SHIFT_MM)
    found = score_displacement(entered(tmp_path, np.zeros_like), pose, TRUTH)
    errors_mm = material_error_mm(pose, TRUTH)
    assert found.tre_deformed_mm == pytest.approx(rms(errors_mm))
    assert found.tre_deformed_covered_mm == pytest.approx(rms(errors_mm[TRUTH.covered]))
    assert found.tre_deformed_uncovered_mm == pytest.approx(rms(errors_mm[~TRUTH.covered]))


def test_an_oblique_grid_of_simpleitk_scores_the_same(tmp_path: Path) -> None:
    """The same displacement, resampled by SimpleITK on axes of its own around the model."""
    image = SimpleITK.Image([30, 30, 30], SimpleITK.sitkVectorFloat64, 3)
    direction = SimpleITK.VersorTransform([0.3, -0.5, 0.2], 0.7).GetMatrix()
    middle_mm, spacing = CASE.fixed_mm.mean(axis=0), 5.0
    corner_mm = middle_mm - np.array(direction).reshape(3, 3) @ np.full(3, 14.5 * spacing)
    image.SetSpacing([spacing] * 3)
    image.SetDirection(direction)
    image.SetOrigin(corner_mm.tolist())
    slope = np.array([[0.0, 0.02, 0.0], [0.0, 0.01, 0.03], [-0.04, 0.0, 0.0]])
    for node in np.ndindex(30, 30, 30):
        image[node] = (slope @ (np.array(image.TransformIndexToPhysicalPoint(node)) - middle_mm)).tolist()
    SimpleITK.WriteImage(image, str(tmp_path / "a_displacement.mha"))
    linear = replace(TRUTH, displacement_mm=(TRUTH.targets_mm - middle_mm) @ slope.T)
    found = score_displacement(tmp_path / "a_displacement.mha", TRUTH.fixed_T_moving, linear)
    assert rms(material_error_mm(TRUTH.fixed_T_moving, linear)) > 0.5
    assert found.tre_deformed_mm < 1e-9
    assert found.jacobian_min == pytest.approx(np.linalg.det(np.eye(3) + slope))


def test_a_folding_field_is_known_by_its_volume_factor(tmp_path: Path) -> None:
    path = entered(tmp_path, lambda points_mm: -1.2 * (points_mm - TRUTH.targets_mm.mean(axis=0)))
    assert score_displacement(path, TRUTH.fixed_T_moving, TRUTH).jacobian_min == pytest.approx(-0.008)


def test_targets_outside_the_grid_are_refused_and_the_file_is_named(tmp_path: Path) -> None:
    write_entry(tmp_path, "a", TRUTH.fixed_T_moving, sway, CASE.fixed_mm[:50] * [1.0, 1.0, 0.3])
    with pytest.raises(InputError, match=r"a_displacement\.nrrd: expected a grid that holds all places"):
        score_displacement(tmp_path / "a_displacement.nrrd", TRUTH.fixed_T_moving, TRUTH)


def test_of_another_vessel_no_displacement_is_right(tmp_path: Path) -> None:
    other = replace(TRUTH, same_vessel=False, fixed_T_moving=np.full((4, 4), np.nan), displacement_mm=None)
    found = score_displacement(entered(tmp_path, sway), np.eye(4), other)
    assert math.isnan(found.tre_deformed_mm) and found.jacobian_min > 0
