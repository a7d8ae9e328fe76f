"""Errors against the tissue of a simulated sweep: known motions have known errors."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from registration import transforms
from registration.phantom.acoustics import Scanner
from registration.phantom.conditions import Deformation, Motion
from registration.phantom.material_error import material_truth, true_rigid_part
from registration.phantom.scan import SimulatedSweep, simulate_sweep
from registration.phantom.settings import PhantomSettings


@lru_cache(maxsize=2)
def swept(bend_mm: float) -> SimulatedSweep:
    settings = PhantomSettings(
        subset="artery",
        scanner=Scanner(height_px=48, width_px=48),
        motion=Motion(frames=30, noise_mm=0.0, noise_deg=0.0),
        deformation=Deformation(bend_mm=bend_mm, pressure_mm=0.0),
    )
    return simulate_sweep(settings, 0, pictures=False)


def targets_of(sweep: SimulatedSweep) -> np.ndarray:
    assert sweep.centerline is not None
    return sweep.centerline.even_points(60)


def test_without_a_deformation_the_true_pose_has_no_error_and_a_moved_one_its_shift() -> None:
    sweep = swept(0.0)
    truth = material_truth(sweep, targets_of(sweep), np.arange(30))
    assert truth.errors_mm(sweep.ct_T_world).max() < 1e-6
    np.testing.assert_allclose(truth.ct_T_world, sweep.ct_T_world, atol=1e-6)
    moved = transforms.compose(transforms.translation(np.array([0.0, 3.0, 4.0])), sweep.ct_T_world)
    np.testing.assert_allclose(truth.errors_mm(moved), 5.0, atol=1e-6)
    # A displacement of the targets by the same shift undoes it.
    shift_mm = np.tile([0.0, 3.0, 4.0], (len(truth.targets_mm), 1))
    assert truth.errors_mm(moved, shift_mm).max() < 1e-6


def test_a_bend_is_undone_by_the_true_displacement_alone() -> None:
    sweep = swept(3.0)
    targets_mm = targets_of(sweep)
    truth = material_truth(sweep, targets_mm, np.arange(30))
    bend_mm = sweep.deformation.as_swept(targets_mm) - targets_mm
    np.testing.assert_allclose(truth.errors_mm(sweep.ct_T_world), np.linalg.norm(bend_mm, axis=1), atol=1e-6)
    assert truth.errors_mm(sweep.ct_T_world, bend_mm).max() < 1e-6
    # The rigid part brings the whole model nearer, and no pose brings it home.
    wall_mm = sweep.model.vertices_mm
    shown_mm = sweep.deformation.as_swept(wall_mm)
    best_mm = transforms.apply(true_rigid_part(sweep), shown_mm) - wall_mm
    assert (best_mm**2).sum() < 0.9 * ((shown_mm - wall_mm) ** 2).sum()
    assert np.linalg.norm(best_mm, axis=1).mean() > 0.2


@pytest.mark.parametrize("used", [np.arange(30), np.arange(10), np.array([4])])
def test_covered_are_the_targets_that_a_used_frame_passes(used: np.ndarray) -> None:
    sweep = swept(0.0)
    targets_mm = targets_of(sweep)
    covered = material_truth(sweep, targets_mm, used).covered
    # The probe moves along the vessel: what is covered is one piece of it, between the first and the last plane used.
    planes_mm = transforms.apply(sweep.ct_T_world, sweep.world_A_pixel[used][:, :3, 3])
    apart_mm = max(1.0, 60.0 / 29)
    low_mm, high_mm = planes_mm[:, 2].min() - 2 * apart_mm, planes_mm[:, 2].max() + 2 * apart_mm
    assert covered.any()
    assert (targets_mm[covered, 2] > low_mm).all()
    assert (targets_mm[covered, 2] < high_mm).all()
    if len(used) == 30:
        inside = (targets_mm[:, 2] > planes_mm[:, 2].min() + apart_mm) & (
            targets_mm[:, 2] < planes_mm[:, 2].max() - apart_mm
        )
        assert covered[inside].all()
