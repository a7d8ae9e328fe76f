"""Poses in the order of time, frames of 8-bit grey."""

from __future__ import annotations

import numpy as np
import pytest
from sweeps import world_T_ee

from registration.errors import InputError
from registration.readers.streams.checks import as_grey, distinct_times


def test_exact_repetition_is_left_out() -> None:
    times_s = np.array([0.0, 1.0, 1.0, 2.0])
    kept_s, poses = distinct_times(times_s, world_T_ee(times_s), "a")
    assert kept_s.tolist() == [0.0, 1.0, 2.0]
    np.testing.assert_array_equal(poses, world_T_ee(kept_s))


@pytest.mark.parametrize("poses_at_s", [[0.0, 1.0, 1.5], [0.0, 1.0, 0.5]])
def test_same_time_with_another_pose_or_backwards_is_refused(poses_at_s: list[float]) -> None:
    times_s = np.array([0.0, 1.0, 1.0 if poses_at_s[2] > 1 else 0.5])
    with pytest.raises(
        InputError, match=r"a: expected poses in the order of their times, found .* \(pose 2\)"
    ):
        distinct_times(times_s, world_T_ee(np.array(poses_at_s)), "a")


def test_grey_of_every_kind() -> None:
    assert as_grey(np.full((1, 2, 2), 200, np.int16), "a").dtype == np.uint8
    assert as_grey(np.full((1, 2, 2, 1), 7, np.uint8), "a").tolist() == [[[7, 7], [7, 7]]]
    assert as_grey(np.array([[[[0, 255, 0, 9]]]], np.uint8), "a").tolist() == [[[150]]]
    assert as_grey(np.zeros((0, 0, 0), np.uint8), "a").shape == (0, 0, 0)


@pytest.mark.parametrize(
    "pixels", [np.full((1, 1, 1), 256), np.full((1, 1, 1), -1), np.zeros((1, 1, 1), np.float32)]
)
def test_other_numbers_are_refused(pixels: np.ndarray) -> None:
    with pytest.raises(InputError, match="a: expected pixels of whole numbers from 0 to 255"):
        as_grey(pixels, "a")
