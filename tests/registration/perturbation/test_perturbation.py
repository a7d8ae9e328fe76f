"""Perturbations that are drawn as they are described, and undone by the pose they come with."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import kstest
from vessels import bent_tube

from registration import transforms
from registration.errors import InputError
from registration.geometry.shapes import Mesh, Surface, surface_frame, transformed
from registration.geometry.vessel_axis import AlongVessel
from registration.metrics.surface_distance import SurfaceDistance, pose_error
from registration.perturbation.perturbation import Perturbation, Piece, draw
from registration.rigid.comparators import SingleStartICP

TUBE = bent_tube()
EXACT = Perturbation(180.0, 10.0, 0.0, 0.0, moving_points=400, fixed_points=700)


def trial(
    perturbation: Perturbation = EXACT, piece: Piece = Piece(), seed: int = 3, number: int = 5, surface=TUBE
):
    return perturbation(surface, surface, np.eye(4), piece, seed=seed, trial=number)


def test_the_pose_that_comes_with_a_trial_undoes_it() -> None:
    drawn = trial()
    assert (len(drawn.moving_mm), len(drawn.fixed_mm)) == (400, 700)
    distance = SurfaceDistance(TUBE)
    assert distance(drawn.fixed_mm).max() < 1e-4
    assert distance(transforms.apply(drawn.fixed_T_moving, drawn.moving_mm)).max() < 1e-4
    assert distance(drawn.moving_mm).max() > 1


# A moving surface as it comes from a tracked sweep: far from the model, in a frame of its own.
TRUTH = transforms.from_rotation(Rotation.from_rotvec([0.3, 2.7, 0.4]), np.array([150.0, -90, 210]))
ELSEWHERE = transformed(TUBE, transforms.invert_rigid(TRUTH))


def elsewhere(perturbation: Perturbation = EXACT, piece: Piece = Piece(), number: int = 5):
    return perturbation(ELSEWHERE, TUBE, TRUTH, piece, seed=3, trial=number)


def test_angle_and_translation_are_the_offset_from_the_truth() -> None:
    for number in range(5):
        drawn = elsewhere(number=number)
        true_mm = transforms.apply(drawn.fixed_T_moving, drawn.moving_mm)
        assert SurfaceDistance(TUBE)(true_mm).max() < 1e-4
        angle_rad = Rotation.from_matrix(drawn.fixed_T_moving[:3, :3]).magnitude()
        assert np.rad2deg(angle_rad) == pytest.approx(drawn.angle_deg, abs=1e-6)
        offset_mm = np.linalg.norm(drawn.moving_mm.mean(axis=0) - true_mm.mean(axis=0))
        assert offset_mm == pytest.approx(drawn.translation_mm, abs=1e-9)


def test_the_frame_that_a_moving_surface_comes_in_changes_nothing() -> None:
    """Its pieces, frames, rolls and flips are those of the vessel at its true pose."""
    for kind in ("any", "roll", "flip"):
        perturbation = dataclasses.replace(EXACT, rotation=kind, missing_share=0.2, sweep_frames=10)
        here, there = trial(perturbation, Piece(0.4, "end")), elsewhere(perturbation, Piece(0.4, "end"))
        np.testing.assert_allclose(there.moving_mm, here.moving_mm, atol=1e-9)
        np.testing.assert_allclose(there.fixed_T_moving, here.fixed_T_moving, atol=1e-9)
        np.testing.assert_array_equal(there.frame, here.frame)
        np.testing.assert_array_equal(there.fixed_mm, here.fixed_mm)


def test_a_single_start_next_to_the_truth_succeeds() -> None:
    near = dataclasses.replace(EXACT, angle_max_deg=2.0, translation_max_mm=1.0)
    drawn = elsewhere(near)
    found = SingleStartICP()(drawn.moving_mm, drawn.fixed_mm)
    targets_mm = TUBE.vertices_mm[::50]
    assert pose_error(found.fixed_T_moving, drawn.fixed_T_moving, targets_mm).tre_mm < 0.5


@pytest.mark.parametrize("surface", [TUBE, TUBE.sample(900, np.random.default_rng(8))])
def test_a_surface_perturbed_against_itself_is_drawn_as_ever(surface: Surface) -> None:
    """Bit by bit: results of earlier versions stay comparable."""
    for number, kind in enumerate(("any", "roll", "flip")):
        settings = Perturbation(180.0, 10.0, 0.4, 0.1, 400, 500, rotation=kind)
        drawn = trial(settings, Piece(0.6, "end"), number=5, surface=surface)
        streams = [np.random.default_rng(s) for s in np.random.SeedSequence((3, 5, number)).spawn(4)]
        pose = settings.poses.draw(AlongVessel.of(surface).axis, 5, streams[0])
        moving_mm = draw(surface, 400, Piece(0.6, "end"), streams[1])
        fixed_mm = draw(surface, 500, Piece(), streams[2])
        low_mm, high_mm = moving_mm.min(axis=0), moving_mm.max(axis=0)
        moving_mm = moving_mm + 0.4 * streams[1].standard_normal(moving_mm.shape)
        margin_mm, strays = 0.5 * (high_mm - low_mm), round(0.1 * len(moving_mm))
        moving_mm[:strays] = streams[1].uniform(low_mm - margin_mm, high_mm + margin_mm, size=(strays, 3))
        moved_T_moving = transforms.compose(
            transforms.translation(pose.shift_mm),
            transforms.rotate_about(pose.rotation, moving_mm.mean(axis=0)),
        )
        np.testing.assert_array_equal(drawn.moving_mm, transforms.apply(moved_T_moving, moving_mm))
        np.testing.assert_array_equal(
            drawn.fixed_mm, fixed_mm + 0.4 * streams[2].standard_normal(fixed_mm.shape)
        )
        np.testing.assert_array_equal(drawn.fixed_T_moving, transforms.invert_rigid(moved_T_moving))


def test_angle_axis_and_translation_are_uniform() -> None:
    small = dataclasses.replace(EXACT, moving_points=20, fixed_points=3)
    angles, lengths, axes, directions = [], [], [], []
    for number in range(400):
        drawn = trial(small, number=number)
        moved_T_moving = transforms.invert_rigid(drawn.fixed_T_moving)
        turn = Rotation.from_matrix(moved_T_moving[:3, :3]).as_rotvec()
        centre = transforms.apply(drawn.fixed_T_moving, drawn.moving_mm).mean(axis=0)
        shift = transforms.apply(moved_T_moving, centre) - centre
        angles.append(np.rad2deg(np.linalg.norm(turn)))
        axes.append(turn / np.linalg.norm(turn))
        lengths.append(np.linalg.norm(shift))
        directions.append(shift / np.linalg.norm(shift))
        assert drawn.angle_deg == pytest.approx(angles[-1], abs=1e-6)
        assert drawn.translation_mm == pytest.approx(lengths[-1], abs=1e-9)
    assert kstest(angles, "uniform", (0, 180)).pvalue > 0.01
    assert kstest(lengths, "uniform", (0, 10)).pvalue > 0.01
    for vectors in (np.array(axes), np.array(directions)):
        # On the sphere each coordinate is uniform between -1 and 1 (Archimedes).
        assert min(kstest(vectors[:, axis], "uniform", (-1, 2)).pvalue for axis in range(3)) > 0.01


def test_a_trial_is_the_same_whatever_was_drawn_before() -> None:
    later = [trial(number=number) for number in (9, 2, 5)][2]
    np.testing.assert_array_equal(later.moving_mm, trial().moving_mm)
    assert trial(number=6).angle_deg != trial().angle_deg
    assert trial(seed=4).angle_deg != trial().angle_deg


def test_poses_do_not_depend_on_overlap_noise_or_points() -> None:
    other = Perturbation(180.0, 10.0, 0.5, 0.1, moving_points=50, fixed_points=60)
    changed = trial(other, Piece(0.5, "end"))
    assert (changed.angle_deg, changed.translation_mm) == (trial().angle_deg, trial().translation_mm)


def test_noise_has_its_deviation_on_both_clouds_and_is_independent() -> None:
    noisy = dataclasses.replace(EXACT, noise_mm=0.4, moving_points=3000, fixed_points=3000)
    plate = Mesh(
        np.array([[0.0, 0, 0], [90, 0, 0], [90, 60, 0], [0, 60, 0]]), np.array([[0, 1, 2], [0, 2, 3]])
    )
    drawn = trial(noisy, surface=plate)
    moving_height = transforms.apply(drawn.fixed_T_moving, drawn.moving_mm)[:, 2]
    for height in (moving_height, drawn.fixed_mm[:, 2]):
        assert height.std() == pytest.approx(0.4, rel=0.05)
        assert abs(height.mean()) < 0.03
    assert abs(np.corrcoef(moving_height, drawn.fixed_mm[:, 2])[0, 1]) < 0.06


def test_outliers_are_counted_marked_and_off_the_surface() -> None:
    drawn = trial(dataclasses.replace(EXACT, outlier_share=0.25))
    assert drawn.outlier.sum() == 100
    away = SurfaceDistance(TUBE)(transforms.apply(drawn.fixed_T_moving, drawn.moving_mm))
    assert away[~drawn.outlier].max() < 1e-4
    assert np.median(away[drawn.outlier]) > 3
    assert not trial().outlier.any()


def test_a_roll_leaves_the_principal_axis_and_a_flip_turns_it_around() -> None:
    axis = surface_frame(TUBE).axes[:, 0]
    for number in range(6):
        roll = trial(dataclasses.replace(EXACT, rotation="roll"), number=number)
        np.testing.assert_allclose(roll.fixed_T_moving[:3, :3] @ axis, axis, atol=1e-9)
        flip = trial(dataclasses.replace(EXACT, rotation="flip"), number=number)
        np.testing.assert_allclose(flip.fixed_T_moving[:3, :3] @ axis, -axis, atol=1e-9)
        assert flip.angle_deg == pytest.approx(180)


def test_kinds_of_rotation_do_not_share_their_clouds() -> None:
    one, other = trial(), trial(dataclasses.replace(EXACT, rotation="roll"))
    assert np.abs(one.fixed_mm - other.fixed_mm).max() > 1


def test_frames_are_slabs_of_the_vessel_whichever_way_it_is_turned() -> None:
    perturbation = dataclasses.replace(EXACT, sweep_frames=10)
    drawn = trial(perturbation, Piece(0.4, "end"))
    placed = transforms.apply(drawn.fixed_T_moving, drawn.moving_mm) @ surface_frame(TUBE).axes[:, 0]
    assert sorted(set(drawn.frame)) == [6, 7, 8, 9]
    for number in (6, 7, 8):
        assert placed[drawn.frame == number].max() <= placed[drawn.frame == number + 1].min()


@pytest.mark.parametrize("number, runs", [(4, False), (5, True)])
def test_lost_frames_take_their_points_along(number: int, runs: bool) -> None:
    whole = trial(dataclasses.replace(EXACT, sweep_frames=20), number=number)
    some = trial(dataclasses.replace(EXACT, sweep_frames=20, missing_share=0.3), number=number)
    lost = sorted(set(whole.frame) - set(some.frame))
    assert len(lost) == 6
    assert (np.ptp(lost) == 5) == runs
    assert some.loss == ("contiguous" if runs else "scattered")
    kept = ~np.isin(whole.frame, lost)
    np.testing.assert_array_equal(some.frame, whole.frame[kept])
    # The pose is about another centroid, but undone it is the same cloud.
    np.testing.assert_allclose(
        transforms.apply(some.fixed_T_moving, some.moving_mm),
        transforms.apply(whole.fixed_T_moving, whole.moving_mm)[kept],
        atol=1e-9,
    )
    assert some.angle_deg == whole.angle_deg


def test_outliers_stay_marked_when_frames_are_lost() -> None:
    drawn = trial(dataclasses.replace(EXACT, outlier_share=0.25, missing_share=0.5))
    away = SurfaceDistance(TUBE)(transforms.apply(drawn.fixed_T_moving, drawn.moving_mm))
    assert len(drawn.outlier) == len(drawn.moving_mm) == len(drawn.frame) < 300
    assert away[~drawn.outlier].max() < 1e-4
    assert np.median(away[drawn.outlier]) > 3


@pytest.mark.parametrize("place, begin, end", [("middle", 0.2, 0.8), ("start", 0.0, 0.6), ("end", 0.4, 1.0)])
def test_a_piece_is_a_share_of_the_extent(place: str, begin: float, end: float) -> None:
    frame = surface_frame(TUBE)
    whole = (TUBE.vertices_mm - frame.centre_mm) @ frame.axes[:, 0]
    drawn = trial(dataclasses.replace(EXACT, moving_points=4000), Piece(0.6, place))
    along = (transforms.apply(drawn.fixed_T_moving, drawn.moving_mm) - frame.centre_mm) @ frame.axes[:, 0]
    share = (along - whole.min()) / np.ptp(whole)
    assert share.min() == pytest.approx(begin, abs=0.02)
    assert share.max() == pytest.approx(end, abs=0.02)
    assert len(drawn.moving_mm) == 4000
    # The fixed cloud stays whole.
    fixed_along = (drawn.fixed_mm - frame.centre_mm) @ frame.axes[:, 0]
    assert np.ptp(fixed_along) > 0.97 * np.ptp(whole)


def test_start_and_end_do_not_swap_with_the_order_of_vertices() -> None:
    backwards = Mesh(TUBE.vertices_mm[::-1].copy(), (len(TUBE.vertices_mm) - 1 - TUBE.triangles)[::-1].copy())
    points = TUBE.vertices_mm
    one, other = Piece(0.4, "start"), Piece(0.4, "end")
    np.testing.assert_array_equal(one.contains(points, TUBE), one.contains(points, backwards))
    assert not (one.contains(points, TUBE) & other.contains(points, TUBE)).any()


def test_a_cloud_gives_its_own_points_each_once() -> None:
    cloud = np.random.default_rng(0).normal(size=(100, 3)) * [9, 3, 1]
    some = draw(cloud, 40, Piece(), np.random.default_rng(1))
    assert len(np.unique(some, axis=0)) == 40
    assert set(map(tuple, some)) <= set(map(tuple, cloud))
    assert len(draw(cloud, 1000, Piece(), np.random.default_rng(1))) == 100


def test_a_piece_with_nothing_in_it_is_refused() -> None:
    dumbbell = np.concatenate([TRIANGLE, TRIANGLE + np.array([100.0, 0, 0])])
    mesh = Mesh(dumbbell, np.array([[0, 1, 2], [3, 4, 5]]))
    with pytest.raises(
        InputError, match=r"piece: expected a piece with surface to sample, received middle 0\.5"
    ):
        draw(mesh, 10, Piece(0.5, "middle"), np.random.default_rng(0))


TRIANGLE = np.array([[0.0, 0, 0], [0, 2, 0], [0, 0, 2]])


@pytest.mark.parametrize(
    "change, message",
    [
        ({"angle_max_deg": 181.0}, "angle_max_deg: expected at most 180"),
        ({"angle_max_deg": -1.0}, "angle_max_deg: expected a number of at least 0"),
        ({"translation_max_mm": float("nan")}, "translation_max_mm: expected"),
        ({"noise_mm": -0.1}, "noise_mm: expected"),
        ({"outlier_share": 1.0}, "outlier_share: expected below 1"),
        ({"missing_share": 1.0}, "missing_share: expected below 1"),
        ({"missing": "sometimes"}, "missing: expected one of scattered, contiguous, alternating"),
        ({"sweep_frames": 0}, "sweep_frames: expected a whole number of at least 1"),
        ({"rotation": "spin"}, "rotation: expected one of any, roll, flip"),
        ({"moving_points": 2}, "moving_points: expected a whole number of at least 3"),
        ({"fixed_points": 0}, "fixed_points: expected a whole number of at least 3"),
    ],
)
def test_settings_out_of_range_are_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        dataclasses.replace(EXACT, **change)


@pytest.mark.parametrize("settings", [{"share": 0.0}, {"share": 1.2}, {"place": "left"}])
def test_pieces_out_of_range_are_refused(settings: dict[str, object]) -> None:
    with pytest.raises(InputError, match=f"{next(iter(settings))}: expected"):
        Piece(**settings)


def test_negative_seeds_are_refused() -> None:
    with pytest.raises(InputError, match="seed: expected a whole number"):
        trial(seed=-1)
