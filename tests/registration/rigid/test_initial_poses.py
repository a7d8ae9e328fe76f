"""Starting poses: that one of them is near the truth, for a whole vessel and for pieces of it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from vessels import bent_tube

from registration import transforms
from registration.geometry.shapes import principal_frame
from registration.perturbation.perturbation import Piece, draw
from registration.rigid.initial_poses import (
    MAX_WINDOWS,
    arc_length_mm,
    arc_windows,
    centerline_starts,
    cone_starts,
    principal_axes,
    symmetry_starts,
)

TUBE = bent_tube()
FIXED = draw(TUBE, 3000, Piece(), np.random.default_rng(0))
POSE = transforms.from_rotation(Rotation.from_rotvec([2.0, -1.2, 0.7]), np.array([90.0, -30, 12]))


def closest_mm(starts: np.ndarray, moving_mm: np.ndarray) -> float:
    truth = transforms.apply(transforms.invert_rigid(POSE), moving_mm)
    placed = np.stack([transforms.apply(start, moving_mm) for start in starts])
    return float(np.sqrt(((placed - truth) ** 2).sum(axis=2).mean(axis=1)).min())


def test_a_whole_vessel_has_one_window_and_every_roll_both_ways() -> None:
    moving = transforms.apply(POSE, draw(TUBE, 900, Piece(), np.random.default_rng(1)))
    starts = symmetry_starts(moving, FIXED, rolls=12, slide_share=0.25, axis_share=1.0)
    assert len(starts) == 24
    transforms.require_rigid(starts, "starts")
    centre = moving.mean(axis=0)
    np.testing.assert_allclose(transforms.apply(starts[0], centre), FIXED.mean(axis=0))
    axis = starts[:, :3, :3] @ principal_frame(moving).axes[:, 0]
    np.testing.assert_allclose(np.abs(axis @ principal_frame(FIXED).axes[:, 0]), 1)
    assert (axis @ principal_frame(FIXED).axes[:, 0] > 0).sum() == 12
    turns = np.sort(
        [
            transforms.rotation_angle_deg(transforms.compose(starts[0], transforms.invert_rigid(s)))
            for s in starts[:12]
        ]
    )
    np.testing.assert_allclose(turns[::2], [0, 30, 60, 90, 120, 150], atol=1e-4)
    assert closest_mm(starts, moving) < 2


@pytest.mark.parametrize("place", ["start", "middle", "end"])
@pytest.mark.parametrize("share", [0.35, 0.6])
def test_some_window_is_the_piece(place: str, share: float) -> None:
    moving = transforms.apply(POSE, draw(TUBE, 900, Piece(share, place), np.random.default_rng(1)))
    starts = symmetry_starts(moving, FIXED, rolls=12, slide_share=0.25, axis_share=1.0)
    assert len(starts) > 24
    assert closest_mm(starts, moving) < 6


def test_a_slide_is_at_most_a_share_of_the_piece() -> None:
    moving = draw(TUBE, 900, Piece(0.4, "middle"), np.random.default_rng(1))
    axis = principal_frame(FIXED).axes[:, 0]
    starts = symmetry_starts(moving, FIXED, rolls=1, slide_share=0.25, axis_share=1.0)
    places = np.unique(np.round([transforms.apply(start, moving.mean(axis=0)) @ axis for start in starts], 6))
    length = np.ptp((moving - moving.mean(axis=0)) @ principal_frame(moving).axes[:, 0])
    assert np.diff(places).max() < 0.25 * length * 1.2


def test_an_axis_of_nearly_equal_spread_is_tried_too() -> None:
    rng = np.random.default_rng(2)
    plate = rng.uniform(-1, 1, (600, 3)) * [10.0, 9.0, 2.0]
    one = symmetry_starts(plate, plate, rolls=4, slide_share=0.5, axis_share=1.0)
    two = symmetry_starts(plate, plate, rolls=4, slide_share=0.5, axis_share=0.8)
    assert len(two) > len(one)
    np.testing.assert_array_equal(two[: len(one)], one)
    transforms.require_rigid(two, "starts")
    second = two[len(one) :, :3, :3] @ principal_frame(plate).axes[:, 1]
    assert np.abs(second @ principal_frame(plate).axes[:, 0]).max() > 0.99


@pytest.mark.parametrize(
    "spread_mm, tried",
    [
        ([9.0, 3.0, 2.0], (0,)),
        ([9.0, 4.4, 2.0], (0,)),
        ([9.0, 4.6, 2.0], (0, 1, 2)),
        ([9.0, 8.9, 8.8], (0, 1, 2)),
    ],
)
def test_a_shape_without_a_principal_axis_has_all_tried(
    spread_mm: list[float], tried: tuple[int, ...]
) -> None:
    assert principal_axes(np.array(spread_mm), axis_share=0.75, compact_share=0.5) == tried
    # Without that rule, the axes of nearly the first one's spread.
    alike = tuple(axis for axis, one in enumerate(spread_mm) if one >= 0.75 * spread_mm[0])
    assert principal_axes(np.array(spread_mm), axis_share=0.75, compact_share=1.0) == alike


def test_an_elongated_shape_has_the_starts_it_had() -> None:
    moving = transforms.apply(POSE, draw(TUBE, 900, Piece(0.6, "middle"), np.random.default_rng(1)))
    plain = symmetry_starts(moving, FIXED, 12, 0.25, 0.75)
    np.testing.assert_array_equal(symmetry_starts(moving, FIXED, 12, 0.25, 0.75, 0.5), plain)


def test_a_compact_piece_starts_near_its_place_whichever_axis_is_the_vessels() -> None:
    """A tube 16 mm wide, cut obliquely to about that length: its first axis is the slanted cut's, not the tube's."""
    rng = np.random.default_rng(5)
    turn = rng.uniform(0, 2 * np.pi, 4000)
    radius = 8.0 + 1.5 * np.cos(2 * turn)
    tube = np.stack([radius * np.cos(turn), radius * np.sin(turn), rng.uniform(0, 60, 4000)], axis=1)
    cut = np.array([0.0, np.sin(np.deg2rad(50)), np.cos(np.deg2rad(50))])
    piece = tube[np.abs((tube - [0, 0, 30]) @ cut) < 7]
    spread_mm = principal_frame(piece).spread_mm
    assert 0.5 < spread_mm[1] / spread_mm[0] < 0.75
    moving = transforms.apply(POSE, piece)
    assert closest_mm(symmetry_starts(moving, tube, 12, 0.25, 0.75), moving) > 5
    assert closest_mm(symmetry_starts(moving, tube, 12, 0.25, 0.75, 0.5), moving) < 3.2


def test_a_longer_moving_cloud_and_a_sliver_have_bounded_starts() -> None:
    piece = draw(TUBE, 900, Piece(0.4, "end"), np.random.default_rng(1))
    assert len(symmetry_starts(FIXED, piece, rolls=6, slide_share=0.25, axis_share=1.0)) == 12
    sliver = np.random.default_rng(3).normal(size=(50, 3)) * [0.05, 0.01, 0.01]
    starts = symmetry_starts(sliver, FIXED, rolls=6, slide_share=0.01, axis_share=1.0)
    assert 0 < len(starts) <= 12 * MAX_WINDOWS


def test_inversion_and_slides_can_be_left_out() -> None:
    piece = transforms.apply(POSE, draw(TUBE, 900, Piece(0.4, "end"), np.random.default_rng(1)))
    settings = {"rolls": 6, "slide_share": 0.25, "axis_share": 1.0}
    every = symmetry_starts(piece, FIXED, **settings)
    one_way = symmetry_starts(piece, FIXED, **settings, invert=False)
    assert 2 * len(one_way) == len(every)
    moved = one_way[:, :3, :3] @ principal_frame(piece).axes[:, 0]
    assert (moved @ principal_frame(FIXED).axes[:, 0] > 0).all()
    unslid = symmetry_starts(piece, FIXED, **settings, slide=False)
    assert len(unslid) == 12
    np.testing.assert_allclose(
        [transforms.apply(start, piece.mean(axis=0)) for start in unslid],
        np.tile(FIXED.mean(axis=0), (12, 1)),
    )


def test_a_cone_holds_the_known_pose_first_turned_and_slid() -> None:
    moving = draw(TUBE, 500, Piece(), np.random.default_rng(1))
    starts = cone_starts(moving, POSE, 40.0, 8.0)
    np.testing.assert_allclose(starts[0], POSE)
    assert len(starts) == 5 * 13
    turned = transforms.rotation_angle_deg(transforms.compose(transforms.invert_rigid(POSE), starts))
    np.testing.assert_allclose(np.sort(turned), 5 * [0] + 30 * [20] + 30 * [40], atol=1e-4)
    centres = np.stack([transforms.apply(start, moving.mean(axis=0)) for start in starts])
    slid = (centres - centres[0]) @ POSE[:3, :3] @ principal_frame(moving).axes[:, 0]
    np.testing.assert_allclose(np.unique(slid.round(6)), [-8, -4, 0, 4, 8])


def arch() -> np.ndarray:
    """A hairpin: two limbs of 60 mm beside each other, joined by half a ring of 10 mm radius."""
    turn = np.linspace(0, np.pi, 33)[1:-1]
    limb = np.arange(0.0, 60.5)
    first = np.stack([np.full(61, 10.0), np.zeros(61), limb], axis=1)
    bow = np.stack([10 * np.cos(turn), np.zeros(31), 60 + 10 * np.sin(turn)], axis=1)
    second = np.stack([np.full(61, -10.0), np.zeros(61), limb[::-1]], axis=1)
    return np.concatenate([first, bow, second])


def test_arc_length_follows_the_line_in_any_order() -> None:
    points = np.random.default_rng(4).permutation(arch(), axis=0)
    assert arc_length_mm(points) == pytest.approx(120 + 10 * np.pi, rel=0.03)


def test_a_jagged_line_is_not_taken_for_a_longer_one() -> None:
    """Points 0.25 mm apart, each off by half a millimetre: joined up, they are three times as long."""
    along = np.linspace(0, 60, 240)
    line = np.stack([10 * np.cos(along / 30), 10 * np.sin(along / 30), along], axis=1)
    length = np.linalg.norm(np.diff(line, axis=0), axis=1).sum()
    rng = np.random.default_rng(9)
    jagged = line + rng.normal(scale=0.5, size=line.shape)
    assert np.linalg.norm(np.diff(jagged, axis=0), axis=1).sum() > 3 * length
    assert arc_length_mm(jagged) == pytest.approx(length, rel=0.15)


def test_windows_along_an_arch_never_hold_both_limbs() -> None:
    windows = arc_windows(arch(), 30.0, 0.25)
    sides = np.array([window.centre_mm for window in windows])
    low = sides[sides[:, 2] < 40]
    assert len(low) >= 6
    np.testing.assert_allclose(np.abs(low[:, 0]), 10, atol=1e-6)
    assert set(np.sign(low[:, 0])) == {-1.0, 1.0}
    assert max(window.spread_mm[0] for window in windows) < 10


def test_a_piece_of_an_arch_starts_on_the_limb_it_is_from() -> None:
    """A radius that changes along the line is not needed: the bend tells the place."""
    line = arch()
    piece = line[45:80]
    moving = transforms.apply(POSE, piece)
    starts = centerline_starts(moving, line, rolls=8, slide_share=0.25, places=16)
    assert closest_mm(starts, moving) < 5


def test_a_line_as_long_as_the_other_has_one_window() -> None:
    assert len(arc_windows(arch(), 151.0, 0.25)) == 1
