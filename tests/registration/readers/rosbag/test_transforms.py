"""Poses from a tree of transforms."""

from __future__ import annotations

import numpy as np
import pytest
from sweeps import world_T_ee

from registration.errors import InputError
from registration.readers.rosbag.transforms import TransformTree

FIXED = world_T_ee(np.array([4.0]))[0]


def tree(times_s: list[float]) -> TransformTree:
    """The end effector moves in the base, which stands in the world; names come with and without a slash."""
    made = TransformTree()
    made.add("/base", "world", None, FIXED)
    for time_s, pose in zip(times_s, world_T_ee(np.array(times_s)), strict=True):
        made.add("ee", "base", time_s, pose)
    return made


def test_static_and_moving_links() -> None:
    times_s, poses = tree([0.0, 0.5, 1.0]).poses("world", "ee", 1.0, "bag")
    assert times_s.tolist() == [0.0, 0.5, 1.0]
    np.testing.assert_allclose(poses, FIXED @ world_T_ee(times_s), atol=1e-9)


def test_repeated_message_counts_once() -> None:
    assert tree([0.0, 0.5, 0.5, 1.0]).poses("/world", "ee", 1.0, "bag")[0].tolist() == [0.0, 0.5, 1.0]


def test_times_outside_the_slower_link_are_left_out() -> None:
    made = tree([0.0, 0.2, 0.4, 0.6, 0.8])
    for time_s in (0.1, 0.5, 0.7):
        made.add("base", "track", time_s, world_T_ee(np.array([time_s]))[0])
    assert made.poses("track", "ee", 0.45, "bag")[0].tolist() == [0.2, 0.4, 0.6]
    assert made.poses("track", "ee", 0.25, "bag")[0].tolist() == [0.6]


@pytest.mark.parametrize(
    ("times_s", "world", "message"),
    [
        ([0.0, 1.0], "room", "bag: transform eeToroom: expected a chain of known transforms"),
        ([0.0, 1.0, 0.5], "world", "bag: ee to base: expected transforms in the order of their times"),
        ([0.5], "world", "bag: ee to base: expected at least two transforms at different times, found 1"),
        ([], "world", "bag: transform eeToworld: expected a chain"),
    ],
)
def test_trees_without_a_pose_are_refused(times_s: list[float], world: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        tree(times_s).poses(world, "ee", 1.0, "bag")


def test_chain_that_does_not_move_is_refused() -> None:
    with pytest.raises(InputError, match="bag: expected a moving chain from base to world"):
        tree([0.0, 1.0]).poses("world", "base", 1.0, "bag")
