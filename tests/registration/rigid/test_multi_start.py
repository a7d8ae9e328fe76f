"""Multi-start registration: poses found again from anywhere, on synthetic vessels and on a real aorta."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from symmetric_shapes import frustum, straight_tube, torus_piece, twisted_fork
from vessels import bent_tube

from registration import transforms
from registration.errors import InputError
from registration.geometry.shapes import Mesh, principal_frame
from registration.io.surfaces import read_centerline, read_surface
from registration.metrics.surface_distance import pose_error
from registration.perturbation.perturbation import Perturbation, Piece, Trial
from registration.phantom.random_anatomy import draw_lines
from registration.phantom.shapes import surround
from registration.rigid.correspondence import Correspondence
from registration.rigid.icp.rejection import NormalRejection
from registration.rigid.multi_start import MultiStartICP
from registration.rigid.search_cone import SearchBound, SearchCone
from registration.rigid.stages import Stages
from registration.rigid.starts import Starts
from registration.rigid.uncertainty import Uncertainty

TUBE = bent_tube()
METHOD = MultiStartICP()


def problem(surface: Mesh = TUBE, piece: Piece = Piece(), number: int = 0, **change: object) -> Trial:
    settings = {"noise_mm": 0.0, "outlier_share": 0.0, "moving_points": 1200, "fixed_points": 2500} | change
    perturbation = Perturbation(180.0, 10.0, **settings)
    return perturbation(surface, surface, np.eye(4), piece, seed=11, trial=number)


def error_mm(found: np.ndarray, trial: Trial, targets_mm: np.ndarray = TUBE.vertices_mm) -> float:
    return pose_error(found, trial.fixed_T_moving, targets_mm).tre_mm


@pytest.mark.parametrize("number", range(6))
def test_a_whole_vessel_is_found_from_any_pose(number: int) -> None:
    trial = problem(number=number)
    assert error_mm(METHOD(trial.moving_mm, trial.fixed_mm).fixed_T_moving, trial) < 0.2


@pytest.mark.parametrize("share, place", [(0.6, "middle"), (0.6, "start"), (0.6, "end"), (0.45, "end")])
def test_a_piece_is_found_in_its_place(share: float, place: str) -> None:
    trial = problem(piece=Piece(share, place), number=7)
    assert error_mm(METHOD(trial.moving_mm, trial.fixed_mm).fixed_T_moving, trial) < 0.5


def test_noise_and_outliers_cost_accuracy_and_not_the_pose() -> None:
    trial = problem(number=3, noise_mm=0.4, outlier_share=0.08)
    assert error_mm(METHOD(trial.moving_mm, trial.fixed_mm).fixed_T_moving, trial) < 1


@pytest.mark.parametrize("number", range(4))
def test_a_piece_among_isolated_points_is_as_long_as_it_is(number: int) -> None:
    """Isolated points lie all around: taken for the vessel's, they would make the piece twice as long."""
    trial = problem(piece=Piece(0.4, "end"), number=number, noise_mm=0.3, outlier_share=0.1)
    found = METHOD(trial.moving_mm, trial.fixed_mm)
    assert error_mm(found.fixed_T_moving, trial) < 2
    assert found.verdict == "accepted", found.reason


def test_the_pose_maps_moving_to_fixed_and_swapping_inverts_it() -> None:
    trial = problem(number=2)
    there = METHOD(trial.moving_mm, trial.fixed_mm).fixed_T_moving
    back = METHOD(trial.fixed_mm, trial.moving_mm).fixed_T_moving
    np.testing.assert_allclose(transforms.compose(back, there), np.eye(4), atol=0.3)
    assert error_mm(there, trial) < 0.2 < error_mm(transforms.invert_rigid(there), trial)


def test_clouds_far_apart_and_far_from_the_origin() -> None:
    trial = problem(number=4)
    away = transforms.from_rotation(Rotation.from_rotvec([1.0, 2.0, -0.5]), np.array([5e3, -2e4, 1e4]))
    found = METHOD(transforms.apply(away, trial.moving_mm), trial.fixed_mm).fixed_T_moving
    assert error_mm(transforms.compose(found, away), trial) < 0.2


def test_it_is_deterministic() -> None:
    trial = problem(number=1)
    one, two = (METHOD(trial.moving_mm, trial.fixed_mm) for _ in range(2))
    np.testing.assert_array_equal(one.fixed_T_moving, two.fixed_T_moving)
    assert one.iterations == two.iterations


def test_the_result_carries_all_candidates_best_first() -> None:
    trial = problem(number=5)
    result = METHOD(trial.moving_mm, trial.fixed_mm)
    np.testing.assert_array_equal(result.candidates[0].fixed_T_moving, result.fixed_T_moving)
    assert [candidate.basin for candidate in result.candidates] == list(range(len(result.candidates)))
    # Every start is in exactly one basin.
    assert sum(candidate.starts for candidate in result.candidates) == 24
    stages = [candidate.stage for candidate in result.candidates]
    assert stages == sorted(stages, key=["fine", "middle", "coarse", "first"].index)
    for stage in set(stages):
        residuals = [candidate.rmse_mm for candidate in result.candidates if candidate.stage == stage]
        assert residuals == sorted(residuals)
    # The tube upside down is another basin, and worse.
    assert any(
        error_mm(candidate.fixed_T_moving, trial) > 20
        for candidate in result.candidates
        if candidate.stage != "fine"
    )
    assert result.converged
    assert result.rmse_trimmed_mm < result.rmse_mm < 1.5
    assert result.inlier_share > 0.95
    assert result.verdict == "accepted", result.reason
    assert result.ambiguity_gap > METHOD.acceptance.min_gap
    best = result.candidates[0]
    assert (best.inlier_share, best.coverage) == (result.inlier_share, result.coverage)
    assert result.coverage > 0.95
    assert result.rmse_bidirectional_mm == best.rmse_bidirectional_mm < 1.5
    for candidate in result.candidates:
        transforms.require_rigid(candidate.start_fixed_T_moving, "start")


def test_two_candidates_of_a_stage_are_different_poses() -> None:
    trial = problem(number=5)
    result = METHOD(trial.moving_mm, trial.fixed_mm)
    radius_mm = np.sqrt(trial.moving_mm.var(axis=0).sum())
    coarse = [candidate for candidate in result.candidates if candidate.stage in ("coarse", "first")]
    placed = np.stack([transforms.apply(candidate.fixed_T_moving, trial.moving_mm) for candidate in coarse])
    for index in range(1, len(placed)):
        apart = np.sqrt(((placed[:index] - placed[index]) ** 2).sum(axis=2).mean(axis=1))
        assert apart.min() > 0.5 * METHOD.stages.basin_share * radius_mm


def test_a_known_pose_keeps_the_search_near_it() -> None:
    """Turned over by 180 degrees, the search stays in that half; near the truth, it ends there."""
    trial = problem(number=6)
    axis = np.cross(trial.moving_mm[0] - trial.moving_mm.mean(axis=0), [0.3, 1.0, 0.2])
    over = transforms.rotate_about(
        Rotation.from_rotvec(np.pi * axis / np.linalg.norm(axis)), trial.moving_mm.mean(axis=0)
    )
    wrong = transforms.compose(trial.fixed_T_moving, over)
    narrow = dataclasses.replace(METHOD, bound=SearchBound(angle_deg=20.0))
    assert error_mm(narrow(trial.moving_mm, trial.fixed_mm, wrong).fixed_T_moving, trial) > 10
    near = transforms.compose(transforms.translation((2.0, -2.0, 1.0)), trial.fixed_T_moving)
    assert error_mm(narrow(trial.moving_mm, trial.fixed_mm, near).fixed_T_moving, trial) < 0.2


def test_no_result_lies_outside_a_search_cone() -> None:
    trial = problem(number=6)
    off = transforms.compose(transforms.translation((3.0, -2.0, 1.0)), trial.fixed_T_moving)
    found = METHOD(trial.moving_mm, trial.fixed_mm, off, search_cone=SearchCone(30.0, 15.0))
    assert error_mm(found.fixed_T_moving, trial) < 0.2
    assert found.verdict == "accepted"
    away = transforms.compose(transforms.translation((60.0, 0, 0)), trial.fixed_T_moving)
    with pytest.raises(InputError, match="search_cone: expected a cone that holds a result"):
        METHOD(trial.moving_mm, trial.fixed_mm, away, search_cone=SearchCone(5.0, 1.0))


def test_centerlines_give_the_same_result_from_other_starts() -> None:
    trial = problem(piece=Piece(0.45, "end"), number=7)
    middle = TUBE.vertices_mm[:-2].reshape(-1, 32, 3).mean(axis=1)
    inside = Piece(0.45, "end").contains(middle, TUBE)
    back = transforms.invert_rigid(trial.fixed_T_moving)
    lines = {"moving_centerline_mm": transforms.apply(back, middle[inside]), "fixed_centerline_mm": middle}
    found = METHOD(trial.moving_mm, trial.fixed_mm, **lines)
    assert error_mm(found.fixed_T_moving, trial) < 0.5
    alone = METHOD(trial.moving_mm, trial.fixed_mm)
    ignoring = dataclasses.replace(METHOD, starts=Starts(use_centerline=False))(
        trial.moving_mm, trial.fixed_mm, **lines
    )
    np.testing.assert_array_equal(ignoring.fixed_T_moving, alone.fixed_T_moving)
    assert found.iterations != alone.iterations


def test_centerlines_of_another_vessel_do_not_mislead() -> None:
    """What they propose is not accepted, so the surfaces' own axes are tried too."""
    trial = problem(piece=Piece(0.45, "end"), number=7)
    turn = np.linspace(0, 4, 90)
    other = np.stack([25 * np.cos(turn), 25 * np.sin(turn), 3 * turn], axis=1)
    found = METHOD(
        trial.moving_mm,
        trial.fixed_mm,
        moving_centerline_mm=other[:40],
        fixed_centerline_mm=other[::-1] + 90.0,
    )
    assert error_mm(found.fixed_T_moving, trial) < 0.5
    assert found.verdict == "accepted", found.reason


def test_a_dense_noisy_cloud_is_thinned_and_found() -> None:
    trial = problem(number=3, noise_mm=0.2, fixed_points=60_000)
    found = METHOD(trial.moving_mm, trial.fixed_mm)
    assert error_mm(found.fixed_T_moving, trial) < 0.3
    whole = dataclasses.replace(METHOD, correspondence=Correspondence(max_fixed_points=60_000))(
        trial.moving_mm, trial.fixed_mm
    )
    assert whole.rmse_mm < found.rmse_mm
    assert error_mm(found.fixed_T_moving, trial) < error_mm(whole.fixed_T_moving, trial)


def test_an_ablated_search_has_fewer_starts() -> None:
    trial = problem(number=2)
    lone = dataclasses.replace(METHOD, starts=Starts(rolls=1, invert=False, slide=False))(
        trial.moving_mm, trial.fixed_mm
    )
    assert sum(candidate.starts for candidate in lone.candidates) == 1


@pytest.mark.parametrize("refine_by", ["plane", "symmetric"])
def test_walls_that_lie_apart_do_not_pull_the_pose(refine_by: str) -> None:
    """The moving wall lies 0.4 mm outside the fixed one, as a mask drawn around the wall does."""
    method = dataclasses.replace(METHOD, refine_by=refine_by)
    corners = TUBE.vertices_mm[TUBE.triangles]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outward = np.zeros_like(TUBE.vertices_mm)
    for corner in range(3):
        np.add.at(outward, TUBE.triangles[:, corner], facing)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    away = TUBE.vertices_mm + outward - TUBE.vertices_mm.mean(axis=0)
    outward *= np.sign((away**2).sum() - ((TUBE.vertices_mm - TUBE.vertices_mm.mean(axis=0)) ** 2).sum())
    wide = Mesh(TUBE.vertices_mm + 0.4 * outward, TUBE.triangles)
    perturbation = Perturbation(180.0, 10.0, 0.1, 0.0, 1500, 3000)
    trial = perturbation(wide, TUBE, np.eye(4), Piece(0.5, "end"), seed=3, trial=0)
    found = method(trial.moving_mm, trial.fixed_mm)
    assert found.wall_offset_mm == pytest.approx(0.4, abs=0.06)
    back = method(trial.fixed_mm, trial.moving_mm).wall_offset_mm
    assert back == pytest.approx(-0.4, abs=0.06)
    error = error_mm(found.fixed_T_moving, trial)
    assert error < 0.4
    without = dataclasses.replace(method, wall_offset=False)(trial.moving_mm, trial.fixed_mm)
    assert np.isnan(without.wall_offset_mm)
    assert error < error_mm(without.fixed_T_moving, trial)


@pytest.mark.parametrize("refine_by", ["plane", "symmetric"])
def test_every_refinement_finds_a_noisy_vessel(refine_by: str) -> None:
    trial = problem(number=9, noise_mm=0.3)
    method = dataclasses.replace(
        METHOD, refine_by=refine_by, correspondence=Correspondence(rejections=(NormalRejection(60.0),))
    )
    found = method(trial.moving_mm, trial.fixed_mm)
    assert error_mm(found.fixed_T_moving, trial) < 0.8
    assert found.verdict == "accepted", found.reason


def disturbed(cloud: np.ndarray, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    pose = transforms.from_rotation(Rotation.random(random_state=seed), rng.uniform(-30, 30, 3))
    return transforms.apply(pose, cloud + rng.normal(scale=0.2, size=cloud.shape))


@pytest.mark.parametrize("seed", range(3))
def test_a_straight_tube_slides_and_rolls(seed: int) -> None:
    """A piece from the middle of a longer tube: the residual is low wherever it lies along it."""
    rng = np.random.default_rng(seed)
    moving = disturbed(straight_tube(20, 55, 1200, rng), seed)
    result = METHOD(moving, straight_tube(0, 90, 3000, rng))
    assert result.rmse_mm < 1
    assert result.verdict == "ambiguous"
    assert {"slide", "roll"} <= set(result.weak_directions)
    assert result.ambiguity_gap < METHOD.acceptance.min_gap


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    "shape, weak",
    [
        (lambda rng, piece: frustum(1200 if piece else 3000, rng), "roll"),
        (
            lambda rng, piece: torus_piece(60, 130, 1200, rng) if piece else torus_piece(0, 200, 3000, rng),
            "slide",
        ),
    ],
    ids=["frustum", "torus"],
)
def test_a_shape_with_a_free_motion_is_ambiguous_in_it(shape: Callable, weak: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    result = METHOD(disturbed(shape(rng, True), seed), shape(rng, False))
    assert result.rmse_mm < 1
    assert result.verdict == "ambiguous", result.reason
    assert weak in result.weak_directions


@pytest.mark.parametrize("seed", range(3))
def test_a_twisted_fork_has_two_poses_and_says_so(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cloud = twisted_fork(1500, rng)
    result = METHOD(disturbed(cloud, seed), twisted_fork(3000, rng))
    assert result.verdict == "ambiguous", result.reason
    half = transforms.compose(
        result.candidates[1].fixed_T_moving, transforms.invert_rigid(result.candidates[0].fixed_T_moving)
    )
    np.testing.assert_allclose(half[:3, :3], np.diag([-1.0, -1, 1]), atol=0.05)


def compact_problem(seed: int, tilt_deg: float, length_widths: float, margin: float) -> Trial:
    """A piece about as long as wide around a branch, cut obliquely, of a model that shows little more than it."""
    rng = np.random.default_rng(seed)
    lines = draw_lines(seed)
    mesh, centre_mm = surround(lines), lines[1].points_mm[0]
    tilt, about = np.deg2rad(tilt_deg), rng.uniform(0, 2 * np.pi)
    cut = np.array([np.sin(tilt) * np.cos(about), np.sin(tilt) * np.sin(about), np.cos(tilt)])
    width_mm = 2 * lines[0].radius_mm[np.linalg.norm(lines[0].points_mm - centre_mm, axis=1).argmin()]
    length_mm = length_widths * width_mm
    moving, fixed = mesh.sample(40_000, rng), mesh.sample(40_000, rng)
    near = np.linalg.norm(moving - centre_mm, axis=1) < 3 * length_mm
    moving = moving[near & (np.abs((moving - centre_mm) @ cut) < length_mm / 2)][:1500]
    near = np.linalg.norm(fixed - centre_mm, axis=1) < 3 * length_mm * (1 + margin)
    fixed = fixed[near & (np.abs((fixed - centre_mm)[:, 2]) < length_mm * (0.5 + margin))][:4000]
    moving = moving + rng.normal(scale=0.3, size=moving.shape)
    pose = transforms.from_rotation(Rotation.random(random_state=seed), rng.uniform(-40, 40, 3))
    frame = np.zeros(len(moving), dtype=np.int64)
    outlier = np.zeros(len(moving), dtype=bool)
    fixed = fixed + rng.normal(scale=0.3, size=fixed.shape)
    return Trial(
        transforms.apply(pose, moving), fixed, transforms.invert_rigid(pose), 0.0, 0.0, outlier, frame, ""
    )


@pytest.mark.parametrize("seed", [208, 210, 216, 220])
def test_a_piece_about_as_long_as_wide_is_found_or_doubted(seed: int) -> None:
    """Where the cut lies decides which axis is longest, so that none of them is the vessel's for sure."""
    trial = compact_problem(seed, 30.0, 1.3, 0.3)
    spread_mm = principal_frame(trial.moving_mm).spread_mm
    assert spread_mm[1] > 0.5 * spread_mm[0]
    found = METHOD(trial.moving_mm, trial.fixed_mm)
    near = transforms.apply(trial.fixed_T_moving, trial.moving_mm)
    assert found.verdict == "ambiguous" or error_mm(found.fixed_T_moving, trial, near) < 2


def test_a_known_share_of_pairs_counts_with_the_kernel_too() -> None:
    trial = problem(number=3, noise_mm=0.3)
    plain = METHOD(trial.moving_mm, trial.fixed_mm)
    half = dataclasses.replace(METHOD, keep=0.5)(trial.moving_mm, trial.fixed_mm)
    assert half.rmse_trimmed_mm < plain.rmse_trimmed_mm
    assert np.abs(half.fixed_T_moving - plain.fixed_T_moving).max() > 1e-4
    assert error_mm(half.fixed_T_moving, trial) < 1
    bare = dataclasses.replace(METHOD, kernel=None)(trial.moving_mm, trial.fixed_mm)
    same = dataclasses.replace(METHOD, kernel=None, keep=0.9)(trial.moving_mm, trial.fixed_mm)
    np.testing.assert_array_equal(bare.fixed_T_moving, same.fixed_T_moving)
    with pytest.raises(InputError, match="keep: expected a number above 0 and at most 1"):
        dataclasses.replace(METHOD, keep=1.5)


def test_clouds_of_different_vessels_do_not_match() -> None:
    rng = np.random.default_rng(0)
    ball = rng.normal(size=(1500, 3))
    ball *= 25 / np.linalg.norm(ball, axis=1, keepdims=True)
    result = METHOD(ball, problem().fixed_mm)
    assert result.verdict == "failed"
    assert not result.converged
    assert "of the moving points lie on the fixed cloud" in result.reason


def test_the_predicted_error_holds_for_most_problems() -> None:
    """Eight problems: the 90 % interval may miss one of them or two, not more."""
    held = 0
    for number in range(8):
        trial = problem(number=20 + number, noise_mm=0.3)
        result = METHOD(trial.moving_mm, trial.fixed_mm)
        low_mm, high_mm = result.tre_interval_mm(TUBE.vertices_mm)
        held += low_mm <= error_mm(result.fixed_T_moving, trial) <= high_mm
        assert 0 < low_mm < high_mm < 2
    assert held >= 6


def test_frames_make_the_blocks_of_the_bootstrap() -> None:
    trial = problem(number=3, noise_mm=0.3)
    along = trial.moving_mm @ np.linalg.svd(trial.moving_mm - trial.moving_mm.mean(axis=0))[2][0]
    frame = np.digitize(along, np.linspace(along.min(), along.max(), 60)).astype(np.int64)
    by_frame = METHOD(trial.moving_mm, trial.fixed_mm, moving_frame=frame)
    by_place = METHOD(trial.moving_mm, trial.fixed_mm)
    np.testing.assert_array_equal(by_frame.fixed_T_moving, by_place.fixed_T_moving)
    targets = TUBE.vertices_mm
    assert by_frame.tre_interval_mm(targets) != by_place.tre_interval_mm(targets)
    assert by_frame.tre_interval_mm(targets)[1] < 1


def test_clouds_that_are_no_surface_go_point_to_point() -> None:
    """A curved line in space: normals mean nothing there."""
    share = np.linspace(0, 1, 300)
    line = np.stack([20 * np.sin(2 * share), 9 * np.cos(3 * share), 60 * share**1.3], axis=1)
    pose = transforms.from_rotation(Rotation.from_rotvec([2.0, 1.0, -1.0]), np.array([7.0, 80, -3]))
    method = dataclasses.replace(METHOD, refine_by="point", keep=1.0)
    found = method(transforms.apply(pose, line), line).fixed_T_moving
    np.testing.assert_allclose(transforms.apply(transforms.compose(found, pose), line), line, atol=0.1)


def test_few_points_are_enough_to_run() -> None:
    rng = np.random.default_rng(0)
    corners = rng.normal(size=(12, 3)) * [9, 4, 2]
    result = dataclasses.replace(METHOD, refine_by="point", keep=1.0)(corners[:8] + 3.0, corners)
    assert np.isfinite(result.fixed_T_moving).all()
    assert result.rmse_mm < 1e-6


@pytest.mark.parametrize(
    "part, name, value",
    [
        (Starts, "rolls", 0),
        (Starts, "slide_share", 0.0),
        (Starts, "axis_share", 1.5),
        (Starts, "centerline_places", 0),
        (Uncertainty, "blocks", 1),
        (Uncertainty, "replicates", 5),
        (Uncertainty, "inflation", 0.0),
        (Stages, "first_points", 2),
        (Stages, "first_iterations", 0),
        (Stages, "first_share", 0.0),
        (Stages, "coarse_points", 2),
        (Stages, "coarse_cells", 4),
        (Stages, "coarse_iterations", 0),
        (Stages, "survivors", 0),
        (Stages, "middle_points", 1),
        (Stages, "finalists", 0),
        (Stages, "fine_points", 2),
        (Stages, "max_iterations", 0),
        (Stages, "tolerance", 0.0),
        (Stages, "basin_share", -0.1),
        (Correspondence, "max_fixed_points", 2),
        (Correspondence, "neighbours", 2),
        (Correspondence, "inlier_spacings", 0.0),
        (SearchBound, "angle_deg", 181.0),
        (MultiStartICP, "keep", 1.1),
        (MultiStartICP, "refine_by", "line"),
        (MultiStartICP, "seed", -1),
        (Starts, "compact_share", 1.5),
        (SearchBound, "radius_mm", 0.0),
    ],
)
def test_settings_out_of_range_are_refused(part: type, name: str, value: object) -> None:
    with pytest.raises(InputError, match=f"{name}: expected"):
        part(**{name: value})


def test_clouds_and_poses_that_are_none_are_refused() -> None:
    cloud = problem().moving_mm
    with pytest.raises(InputError, match="moving_mm: expected at least 3 points, received 0"):
        METHOD(np.empty((0, 3)), cloud)
    broken = cloud.copy()
    broken[3, 1] = np.nan
    with pytest.raises(InputError, match="fixed_mm: expected finite coordinates, received 1 points"):
        METHOD(cloud, broken)
    with pytest.raises(InputError, match=r"moving_mm: .*on one line"):
        METHOD(np.outer(np.arange(50.0), [1, 2, 3]), cloud)
    with pytest.raises(InputError, match="initial: expected orthonormal"):
        METHOD(cloud, cloud, np.diag([1.0, 1, 1.2, 1]))
    with pytest.raises(InputError, match="search_cone: expected an initial pose"):
        METHOD(cloud, cloud, search_cone=SearchCone())
    with pytest.raises(
        InputError, match="moving_frame: expected one frame for each of 1200 points, received 3"
    ):
        METHOD(cloud, cloud, moving_frame=np.zeros(3, dtype=np.int64))
    with pytest.raises(InputError, match="fixed_centerline_mm: expected at least 2 points, received 1"):
        METHOD(cloud, cloud, moving_centerline_mm=cloud[:9], fixed_centerline_mm=cloud[:1])


@pytest.mark.parametrize("share, place", [(1.0, "middle"), (0.6, "middle"), (0.4, "start"), (0.4, "end")])
def test_the_real_aorta_is_found_in_every_trial(real_data: Path, share: float, place: str) -> None:
    aorta = read_surface(real_data / "vmtk" / "aorta-surface.stl")
    targets = read_centerline(real_data / "vmtk" / "aorta-centerline.vtp").even_points(500)
    for number in range(3):
        trial = problem(
            aorta, Piece(share, place), number, noise_mm=0.5, moving_points=3000, fixed_points=5000
        )
        found = METHOD(trial.moving_mm, trial.fixed_mm).fixed_T_moving
        assert error_mm(found, trial, targets) < 2
