"""Which pairs each rule leaves out, on pairs written down by hand."""

from __future__ import annotations

import numpy as np
import pytest

from registration.errors import InputError
from registration.rigid.icp.pairs import Pairs
from registration.rigid.icp.rejection import (
    DistanceRejection,
    NormalRejection,
    TrimRejection,
    trimming_weights,
)


def pairs(distances_mm: list[float], angles_deg: list[float] | None = None) -> Pairs:
    """One pose; each fixed point straight above its moved one, its normal turned by an angle."""
    moved = np.zeros((1, len(distances_mm), 3))
    moved[0, :, 0] = np.arange(len(distances_mm))
    fixed = moved + np.array(distances_mm)[None, :, None] * [0.0, 0, 1]
    if angles_deg is None:
        return Pairs(moved, fixed)
    angles = np.deg2rad(angles_deg)
    turned = np.stack([np.sin(angles), np.zeros_like(angles), np.cos(angles)], axis=1)[None]
    return Pairs(moved, fixed, turned, np.tile([0.0, 0, 1], (1, len(angles), 1)))


def test_trimming_keeps_the_closest_share() -> None:
    squared = np.array([[4.0, 1, 9, 16, 0], [1, 2, 3, 4, 5]])
    np.testing.assert_array_equal(trimming_weights(squared, 0.6), [[1, 1, 0, 0, 1], [1, 1, 1, 0, 0]])
    np.testing.assert_array_equal(trimming_weights(squared, 1.0), np.ones((2, 5)))
    # Three pairs at least, or no rotation follows from them.
    np.testing.assert_array_equal(trimming_weights(squared, 0.01).sum(axis=1), [3, 3])


def test_trimming_is_by_distance() -> None:
    np.testing.assert_array_equal(TrimRejection(0.75)(pairs([3.0, 1.0, 9.0, 2.0])), [[1, 1, 0, 1]])


def test_a_distance_is_kept_up_to_its_limit() -> None:
    np.testing.assert_array_equal(DistanceRejection(2.0)(pairs([1.0, 2.0, 2.1])), [[1, 1, 0]])


def test_normals_count_as_lines_without_a_sign() -> None:
    found = NormalRejection(45.0)(pairs([1.0] * 5, [0.0, 44.0, 46.0, 136.0, 180.0]))
    np.testing.assert_array_equal(found, [[1, 1, 0, 1, 1]])


def test_normals_that_are_missing_are_refused() -> None:
    with pytest.raises(InputError, match="pairs: expected normals of both clouds"):
        NormalRejection()(pairs([1.0]))


@pytest.mark.parametrize(
    "rule, setting",
    [(TrimRejection, "keep"), (DistanceRejection, "max_distance_mm"), (NormalRejection, "max_angle_deg")],
)
def test_settings_out_of_range_are_refused(rule: type, setting: str) -> None:
    with pytest.raises(InputError, match=f"{setting}: expected"):
        rule(**{setting: 0.0})
