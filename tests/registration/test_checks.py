"""Settings that are refused, and those at the edge that are not."""

from __future__ import annotations

import math

import pytest

from registration.checks import require_at_least, require_count, require_positive
from registration.errors import InputError


def test_values_at_the_edge_pass() -> None:
    require_at_least("noise_mm", 0.0, 0.0)
    require_count("trials", 1, 1)
    require_positive("share", 1.0, 1.0)


@pytest.mark.parametrize("value", [-0.1, math.nan, math.inf, True, "2", None])
def test_at_least_names_setting_and_value(value: object) -> None:
    with pytest.raises(InputError, match=r"noise_mm: expected a number of at least 0, received"):
        require_at_least("noise_mm", value, 0.0)


@pytest.mark.parametrize("value", [0, 2.0, True, "3", None])
def test_counts_are_whole_numbers(value: object) -> None:
    with pytest.raises(InputError, match="trials: expected a whole number of at least 1, received"):
        require_count("trials", value, 1)


@pytest.mark.parametrize("value", [0.0, -1.0, 1.5, math.nan, math.inf, False, "0.5"])
def test_shares_lie_above_zero_and_up_to_one(value: object) -> None:
    with pytest.raises(InputError, match="share: expected a number above 0 and at most 1, received"):
        require_positive("share", value, 1.0)
