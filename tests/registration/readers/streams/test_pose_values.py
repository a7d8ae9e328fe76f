"""Units told from what a sweep spans, wherever its origin lies."""

from __future__ import annotations

import numpy as np
import pytest

from registration.errors import InputError
from registration.readers.streams.pose_values import require_unit, span_mm, unit_quaternions

PATH_MM = np.column_stack([np.linspace(0, 80, 50), np.zeros(50), np.linspace(0, 5, 50)])


@pytest.mark.parametrize("origin_mm", [0.0, 700.0, 25000.0])
def test_metres_taken_for_millimetres_are_seen_from_the_span(origin_mm: float) -> None:
    require_unit(PATH_MM + origin_mm, "mm", "a", "say units")
    with pytest.raises(
        InputError, match=r"a: expected positions in mm, found a span of 0\.0721 mm .*say units"
    ):
        require_unit((PATH_MM + origin_mm) / 1000, "mm", "a", "say units")


@pytest.mark.parametrize("origin_mm", [0.0, 700.0])
def test_millimetres_taken_for_metres_are_seen_from_the_span(origin_mm: float) -> None:
    require_unit(PATH_MM + origin_mm, "m", "a", "say units")
    with pytest.raises(
        InputError, match=r"a: .* at most 3 m, found 72\.\d m \(were they millimetres\? say units"
    ):
        require_unit((PATH_MM + origin_mm) * 1000, "m", "a", "say units")


def test_one_mislaid_pose_does_not_decide_the_unit() -> None:
    mislaid = PATH_MM.copy()
    mislaid[7] = 1e7
    assert span_mm(mislaid) < 100
    require_unit(mislaid, "m", "a", "say units")


def test_a_probe_at_rest_has_no_unit_unless_it_is_at_the_origin() -> None:
    require_unit(np.full((4, 3), 300.0), "mm", "a", "say units")
    with pytest.raises(InputError, match="were they metres"):
        require_unit(np.full((4, 3), 0.3), "mm", "a", "say units")


def test_quaternions_within_a_percent_of_length_1() -> None:
    lengths = np.array([0.98, 0.991, 1.0, 1.003, 1.009, 1.02, 0.0, np.nan])
    found = unit_quaternions(lengths[:, None] * np.array([[0.5, 0.5, 0.5, 0.5]]))
    assert found.tolist() == [False, True, True, True, True, False, False, False]
