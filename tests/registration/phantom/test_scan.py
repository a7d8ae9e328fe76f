"""Whole sweeps: the truth fits the frames, noise and latency are what was asked for, and everything repeats."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import binary_dilation, binary_erosion

from registration import transforms
from registration.errors import InputError
from registration.phantom.acoustics import Scanner, Tissue
from registration.phantom.conditions import Deformation, Motion
from registration.phantom.distance import distance_grid
from registration.phantom.scan import SimulatedSweep, simulate_sweep
from registration.phantom.settings import PhantomSettings
from registration.phantom.simulator import SweepSimulator
from registration.reconstruction.contours import ContourExtractor
from registration.synchronisation import synchronise

STIFF = Deformation(bend_mm=0.0, pressure_mm=0.0)
STILL = Motion(frames=3, noise_mm=0.0, noise_deg=0.0)
SMALL = PhantomSettings(
    subset="artery", scanner=Scanner(height_px=128, width_px=128), motion=Motion(frames=6), deformation=STIFF
)


@pytest.fixture(scope="module")
def stiff() -> SimulatedSweep:
    return simulate_sweep(SMALL, 0)


@pytest.fixture(scope="module")
def soft() -> SimulatedSweep:
    return simulate_sweep(
        replace(SMALL, subset="vein", deformation=Deformation(), motion=Motion(frames=8)), 1
    )


def test_true_contours_lie_on_the_anatomy(stiff: SimulatedSweep) -> None:
    cloud = ContourExtractor()(stiff.masks, stiff.world_A_pixel)
    assert len(cloud.points_mm) > 500
    apart_mm = distance_grid(stiff.anatomy).at(transforms.apply(stiff.ct_T_world, cloud.points_mm))
    # Pixels measure 0.31 mm; a binary mask knows its border to about half of that.
    assert abs(apart_mm.mean()) < 0.05
    assert np.percentile(np.abs(apart_mm), 95) < 0.2


def test_a_displacement_that_is_given_takes_the_place_of_the_bend(stiff: SimulatedSweep) -> None:
    shift_mm = np.array([0.0, 2.0, 0.0])
    moved = simulate_sweep(SMALL, 0, pictures=False, displacement=lambda points_mm: points_mm + shift_mm)
    cloud = ContourExtractor()(moved.masks, moved.world_A_pixel)
    in_ct_mm = transforms.apply(moved.ct_T_world, cloud.points_mm)
    assert abs(distance_grid(stiff.anatomy).at(in_ct_mm - shift_mm).mean()) < 0.05
    np.testing.assert_allclose(moved.deformation.as_swept(in_ct_mm), in_ct_mm + shift_mm)
    np.testing.assert_array_equal(moved.model.vertices_mm, stiff.model.vertices_mm)


def test_deformed_contours_lie_on_the_displaced_anatomy(soft: SimulatedSweep) -> None:
    from scipy.spatial import cKDTree

    cloud = ContourExtractor()(soft.masks, soft.world_A_pixel)
    in_ct_mm = transforms.apply(soft.ct_T_world, cloud.points_mm)
    rigid_mm = np.abs(distance_grid(soft.anatomy).at(in_ct_mm))
    assert np.percentile(rigid_mm, 90) > 0.5
    for frame in (1, 5):
        surface_mm = soft.deformation.displaced(soft.anatomy.vertices_mm, frame)
        apart_mm, _ = cKDTree(surface_mm).query(in_ct_mm[cloud.frame_index == frame])
        # Vertices are 0.4 mm apart.
        assert np.percentile(apart_mm, 95) < 0.35


def test_pressure_flattens_the_vein_and_is_recorded(soft: SimulatedSweep) -> None:
    assert (soft.deformation.pressure_mm > 0.4).all()
    assert soft.deformation.pressure_mm.max() < 2.0
    settings = replace(soft.settings, deformation=replace(soft.settings.deformation, squeeze=0.0))
    pressed, unpressed = SweepSimulator(soft.settings, 1), SweepSimulator(settings, 1)
    masks = [maker.frame(4, maker.view(4))[1] for maker in (pressed, unpressed)]
    heights = [np.count_nonzero(mask.any(axis=1)) for mask in masks]
    assert heights[0] < 0.95 * heights[1]


def test_recorded_poses_lead_to_the_same_place_within_their_noise(stiff: SimulatedSweep) -> None:
    posed = synchronise(stiff.sweep, max_gap_s=0.05)
    assert len(posed.kept) == len(stiff.masks)
    corner_mm = np.array([64.0, 64.0, 0.0])
    there, truth = (
        np.stack([transforms.apply(matrix, corner_mm) for matrix in stack])
        for stack in (posed.world_A_pixel, stiff.world_A_pixel)
    )
    error_mm = np.linalg.norm(there - truth, axis=1)
    # 0.1 mm and 0.1 degrees over an arm of some 170 mm.
    assert 0.05 < np.median(error_mm) < 0.8


def test_without_noise_poses_are_exact_and_latency_shifts_the_clock() -> None:
    late = simulate_sweep(replace(SMALL, motion=replace(STILL, latency_s=0.06)), 1)
    # Adding the latency to the poses' clock brings them to the late frames.
    posed = synchronise(late.sweep, max_gap_s=0.05, offset_s=0.06)
    np.testing.assert_allclose(posed.world_A_pixel, late.world_A_pixel[posed.kept], atol=0.02)
    shifted = synchronise(late.sweep, max_gap_s=0.05)
    moved_mm = np.linalg.norm(shifted.world_A_pixel[0, :3, 3] - late.world_A_pixel[shifted.kept[0], :3, 3])
    assert 0.1 < moved_mm < 2.0


def test_calibration_error_has_the_size_asked_for() -> None:
    exact, wrong = (
        simulate_sweep(replace(SMALL, motion=replace(STILL, calibration_mm=size, calibration_deg=size)), 0)
        for size in (0.0, 1.0)
    )
    off = transforms.invert_rigid(exact.sweep.calibration.ee_T_probe) @ wrong.sweep.calibration.ee_T_probe
    assert np.linalg.norm(off[:3, 3]) == pytest.approx(1.0)
    assert transforms.rotation_angle_deg(off) == pytest.approx(1.0)
    np.testing.assert_allclose(wrong.world_A_pixel, exact.world_A_pixel)
    np.testing.assert_array_equal(wrong.sweep.world_T_ee, exact.sweep.world_T_ee)


def test_wrong_sound_speed_moves_the_mask_as_it_moves_the_picture() -> None:
    settings = replace(SMALL, tissue=Tissue(sound_speed_m_s=1400.0))
    makers = SweepSimulator(SMALL, 0), SweepSimulator(settings, 0)
    middles = []
    for maker in makers:
        mask = maker.frame(3, maker.view(3))[1]
        middles.append((np.flatnonzero(mask.any(axis=1)).mean() + 0.5) * maker.settings.scanner.pixel_mm)
    assert middles[1] == pytest.approx(1.1 * middles[0], abs=0.3)


@pytest.mark.parametrize("sweep", ["stiff", "soft"])
def test_pictures_show_the_vessel_where_the_mask_is(sweep: str, request: pytest.FixtureRequest) -> None:
    made: SimulatedSweep = request.getfixturevalue(sweep)
    inside = np.stack([binary_erosion(mask, iterations=3) for mask in made.masks]) & ~made.hidden
    around = np.stack(
        [binary_dilation(mask, iterations=9) & ~binary_dilation(mask, iterations=2) for mask in made.masks]
    )
    images = made.sweep.images.astype(float)
    assert images[inside].mean() < images[around & ~made.hidden].mean() - 18


def test_same_seed_same_bytes_and_sweeps_share_the_phantom(stiff: SimulatedSweep) -> None:
    again, other = simulate_sweep(SMALL, 0), simulate_sweep(SMALL, 1)
    np.testing.assert_array_equal(again.sweep.images, stiff.sweep.images)
    np.testing.assert_array_equal(again.sweep.world_T_ee, stiff.sweep.world_T_ee)
    np.testing.assert_array_equal(again.masks, stiff.masks)
    assert (other.sweep.images != stiff.sweep.images).any()
    np.testing.assert_array_equal(other.ct_T_world, stiff.ct_T_world)
    np.testing.assert_array_equal(other.model.vertices_mm, stiff.model.vertices_mm)
    reseeded = simulate_sweep(replace(SMALL, seed=1, motion=STILL), 0)
    assert np.abs(reseeded.ct_T_world - stiff.ct_T_world).max() > 0.1
    with pytest.raises(InputError, match="sweep"):
        simulate_sweep(SMALL, -1)


def test_a_frame_made_alone_is_the_frame_of_the_sweep(stiff: SimulatedSweep) -> None:
    maker = SweepSimulator(SMALL, 0)
    picture, mask, _ = maker.frame(5, maker.view(5))
    np.testing.assert_array_equal(picture, stiff.sweep.images[5])
    np.testing.assert_array_equal(mask, stiff.masks[5])


def test_model_is_in_the_ct_frame_and_not_the_anatomy(stiff: SimulatedSweep) -> None:
    assert len(stiff.model.vertices_mm) != len(stiff.anatomy.vertices_mm)
    apart_mm = distance_grid(stiff.anatomy).at(stiff.model.vertices_mm)
    inner = np.abs(stiff.model.vertices_mm[:, 2]) < 35
    assert np.abs(apart_mm[inner]).mean() < 0.3


def test_a_users_mesh_keeps_its_own_frame(real_data: Path) -> None:
    path = real_data / "vmtk" / "aorta-surface.stl"
    settings = replace(SMALL, subset="mesh", mesh=str(path), motion=STILL)
    made = simulate_sweep(settings, 0)
    from registration.io.surfaces import read_surface

    mesh = read_surface(path)
    np.testing.assert_allclose(made.anatomy.vertices_mm, mesh.vertices_mm, atol=1e-6)
    assert made.centerline is None
    cloud = ContourExtractor()(made.masks, made.world_A_pixel)
    apart_mm = distance_grid(made.anatomy).at(transforms.apply(made.ct_T_world, cloud.points_mm))
    assert np.percentile(np.abs(apart_mm), 95) < 0.2


def test_an_open_mesh_is_refused(real_data: Path) -> None:
    path = real_data / "vmtk" / "aorta-surface-open-ends.stl"
    with pytest.raises(InputError, match="closed surface"):
        simulate_sweep(replace(SMALL, subset="mesh", mesh=str(path)), 0)


def test_without_pictures_everything_else_is_the_same(soft: SimulatedSweep) -> None:
    quick = simulate_sweep(soft.settings, 1, pictures=False)
    assert not quick.sweep.images.any()
    assert soft.sweep.images.any()
    np.testing.assert_array_equal(quick.masks, soft.masks)
    np.testing.assert_array_equal(quick.sweep.world_T_ee, soft.sweep.world_T_ee)
    np.testing.assert_array_equal(quick.world_A_pixel, soft.world_A_pixel)
    np.testing.assert_array_equal(quick.deformation.pressure_mm, soft.deformation.pressure_mm)
