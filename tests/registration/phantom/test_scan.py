"""Whole sweeps: the truth fits the frames, noise and latency are what was asked for, and everything repeats."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from registration import frames
from registration.contours import ContourExtractor
from registration.phantom.scan import SimulatedSweep, simulate_sweep
from registration.phantom.settings import Motion, PhantomSettings, Scanner
from registration.synchronisation import synchronise

SMALL = PhantomSettings(
    subset="artery", scanner=Scanner(height_px=128, width_px=128), motion=Motion(frames=10)
)


@pytest.fixture(scope="module")
def artery() -> SimulatedSweep:
    return simulate_sweep(SMALL, 0)


def test_true_contours_lie_on_the_anatomy(artery: SimulatedSweep) -> None:
    from registration.phantom.distance import distance_grid

    cloud = ContourExtractor()(artery.masks, artery.world_A_pixel)
    assert len(cloud.points_mm) > 500
    apart_mm = distance_grid(artery.anatomy).at(frames.apply(artery.ct_T_world, cloud.points_mm))
    # Pixels measure 0.31 mm; a binary mask knows its border to about half of that.
    assert abs(apart_mm.mean()) < 0.05
    assert np.percentile(np.abs(apart_mm), 95) < 0.2


def test_recorded_poses_lead_to_the_same_place_within_their_noise(artery: SimulatedSweep) -> None:
    posed = synchronise(artery.sweep, max_gap_s=0.05)
    assert len(posed.kept) == len(artery.masks)
    corner_mm = np.array([64.0, 64.0, 0.0])
    there = np.stack([frames.apply(matrix, corner_mm) for matrix in posed.world_A_pixel])
    truth = np.stack([frames.apply(matrix, corner_mm) for matrix in artery.world_A_pixel])
    error_mm = np.linalg.norm(there - truth, axis=1)
    assert 0.01 < np.median(error_mm) < 1.0


def test_without_noise_poses_are_exact_and_latency_shifts_the_clock() -> None:
    still = replace(SMALL, motion=Motion(frames=6, noise_mm=0.0, noise_deg=0.0, latency_s=0.06))
    late = simulate_sweep(still, 1)
    # Adding the latency to the poses' clock brings them to the late frames.
    posed = synchronise(late.sweep, max_gap_s=0.05, offset_s=0.06)
    np.testing.assert_allclose(posed.world_A_pixel, late.world_A_pixel[posed.kept], atol=0.02)
    shifted = synchronise(late.sweep, max_gap_s=0.05)
    moved_mm = np.linalg.norm(shifted.world_A_pixel[0, :3, 3] - late.world_A_pixel[shifted.kept[0], :3, 3])
    assert 0.1 < moved_mm < 2.0


def test_pictures_show_the_vessel_where_the_mask_is(artery: SimulatedSweep) -> None:
    images = artery.sweep.images.astype(float)
    assert images.dtype == float
    from scipy.ndimage import binary_dilation, binary_erosion

    inside = np.stack([binary_erosion(mask, iterations=3) for mask in artery.masks])
    around = np.stack([binary_dilation(mask, iterations=9) for mask in artery.masks]) & ~np.stack(
        [binary_dilation(mask, iterations=2) for mask in artery.masks]
    )
    assert images[inside].mean() < images[around].mean() - 25


def test_same_seed_same_bytes_and_sweeps_share_the_phantom(artery: SimulatedSweep) -> None:
    again, other = simulate_sweep(SMALL, 0), simulate_sweep(SMALL, 1)
    np.testing.assert_array_equal(again.sweep.images, artery.sweep.images)
    np.testing.assert_array_equal(again.sweep.world_T_ee, artery.sweep.world_T_ee)
    np.testing.assert_array_equal(again.masks, artery.masks)
    assert (other.sweep.images != artery.sweep.images).any()
    np.testing.assert_array_equal(other.ct_T_world, artery.ct_T_world)
    np.testing.assert_array_equal(other.model.vertices_mm, artery.model.vertices_mm)
    reseeded = simulate_sweep(replace(SMALL, seed=1), 0)
    assert np.abs(reseeded.ct_T_world - artery.ct_T_world).max() > 0.1


def test_model_is_in_the_ct_frame_and_not_the_anatomy(artery: SimulatedSweep) -> None:
    from registration.phantom.distance import distance_grid

    assert len(artery.model.vertices_mm) != len(artery.anatomy.vertices_mm)
    apart_mm = distance_grid(artery.anatomy).at(artery.model.vertices_mm)
    inner = np.abs(artery.model.vertices_mm[:, 2]) < 35
    assert np.abs(apart_mm[inner]).mean() < 0.3
