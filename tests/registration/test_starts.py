"""Starting poses: that one of them is near the truth, for a whole vessel and for pieces of it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from vessels import bent_tube

from registration import frames
from registration.geometry import principal_frame
from registration.perturbation import Piece, draw
from registration.starts import MOST_WINDOWS, cone_starts, symmetry_starts

TUBE = bent_tube()
FIXED = draw(TUBE, 3000, Piece(), np.random.default_rng(0))
POSE = frames.from_rotation(Rotation.from_rotvec([2.0, -1.2, 0.7]), np.array([90.0, -30, 12]))


def closest_mm(starts: np.ndarray, moving_mm: np.ndarray) -> float:
    truth = frames.apply(frames.invert_rigid(POSE), moving_mm)
    placed = np.stack([frames.apply(start, moving_mm) for start in starts])
    return float(np.sqrt(((placed - truth) ** 2).sum(axis=2).mean(axis=1)).min())


def test_a_whole_vessel_has_one_window_and_every_roll_both_ways() -> None:
    moving = frames.apply(POSE, draw(TUBE, 900, Piece(), np.random.default_rng(1)))
    starts = symmetry_starts(moving, FIXED, rolls=12, slide_share=0.25, axis_share=1.0)
    assert len(starts) == 24
    frames.require_rigid(starts, "starts")
    centre = moving.mean(axis=0)
    np.testing.assert_allclose(frames.apply(starts[0], centre), FIXED.mean(axis=0))
    axis = starts[:, :3, :3] @ principal_frame(moving).axes[:, 0]
    np.testing.assert_allclose(np.abs(axis @ principal_frame(FIXED).axes[:, 0]), 1)
    assert (axis @ principal_frame(FIXED).axes[:, 0] > 0).sum() == 12
    turns = np.sort(
        [frames.rotation_angle_deg(frames.compose(starts[0], frames.invert_rigid(s))) for s in starts[:12]]
    )
    np.testing.assert_allclose(turns[::2], [0, 30, 60, 90, 120, 150], atol=1e-4)
    assert closest_mm(starts, moving) < 2


@pytest.mark.parametrize("place", ["start", "middle", "end"])
@pytest.mark.parametrize("share", [0.35, 0.6])
def test_some_window_is_the_piece(place: str, share: float) -> None:
    moving = frames.apply(POSE, draw(TUBE, 900, Piece(share, place), np.random.default_rng(1)))
    starts = symmetry_starts(moving, FIXED, rolls=12, slide_share=0.25, axis_share=1.0)
    assert len(starts) > 24
    assert closest_mm(starts, moving) < 6


def test_a_slide_is_at_most_a_share_of_the_piece() -> None:
    moving = draw(TUBE, 900, Piece(0.4, "middle"), np.random.default_rng(1))
    axis = principal_frame(FIXED).axes[:, 0]
    starts = symmetry_starts(moving, FIXED, rolls=1, slide_share=0.25, axis_share=1.0)
    places = np.unique(np.round([frames.apply(start, moving.mean(axis=0)) @ axis for start in starts], 6))
    length = np.ptp((moving - moving.mean(axis=0)) @ principal_frame(moving).axes[:, 0])
    assert np.diff(places).max() < 0.25 * length * 1.2


def test_an_axis_of_nearly_equal_spread_is_tried_too() -> None:
    rng = np.random.default_rng(2)
    plate = rng.uniform(-1, 1, (600, 3)) * [10.0, 9.0, 2.0]
    one = symmetry_starts(plate, plate, rolls=4, slide_share=0.5, axis_share=1.0)
    two = symmetry_starts(plate, plate, rolls=4, slide_share=0.5, axis_share=0.8)
    assert len(two) > len(one)
    np.testing.assert_array_equal(two[: len(one)], one)
    frames.require_rigid(two, "starts")
    second = two[len(one) :, :3, :3] @ principal_frame(plate).axes[:, 1]
    assert np.abs(second @ principal_frame(plate).axes[:, 0]).max() > 0.99


def test_a_longer_moving_cloud_and_a_sliver_have_bounded_starts() -> None:
    piece = draw(TUBE, 900, Piece(0.4, "end"), np.random.default_rng(1))
    assert len(symmetry_starts(FIXED, piece, rolls=6, slide_share=0.25, axis_share=1.0)) == 12
    sliver = np.random.default_rng(3).normal(size=(50, 3)) * [0.05, 0.01, 0.01]
    starts = symmetry_starts(sliver, FIXED, rolls=6, slide_share=0.01, axis_share=1.0)
    assert 0 < len(starts) <= 12 * MOST_WINDOWS


def test_a_cone_holds_the_known_pose_first_and_turns_about_the_cloud() -> None:
    moving = draw(TUBE, 500, Piece(), np.random.default_rng(1))
    starts = cone_starts(moving, POSE, 40.0)
    np.testing.assert_array_equal(starts[0], POSE)
    turned = frames.rotation_angle_deg(frames.compose(frames.invert_rigid(POSE), starts))
    np.testing.assert_allclose(np.sort(turned), [0] + 6 * [20] + 6 * [40], atol=1e-4)
    centres = np.stack([frames.apply(start, moving.mean(axis=0)) for start in starts])
    np.testing.assert_allclose(centres - centres[0], 0, atol=1e-9)
