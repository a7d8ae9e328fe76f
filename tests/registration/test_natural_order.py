"""Numbered names in the order of their numbers."""

from __future__ import annotations

import pytest

from registration.errors import InputError
from registration.natural_order import natural_key, natural_order


def test_numbers_compare_as_numbers_whatever_the_case() -> None:
    names = [f"frame_{index}" for index in range(24)]
    assert natural_order(sorted(names), "a") == names
    assert natural_order(["B2", "b10", "b1"], "a") == ["b1", "B2", "b10"]
    assert natural_order(["s2_f1", "s1_f10", "s1_f9", "scan", "1"], "a") == [
        "1",
        "s1_f9",
        "s1_f10",
        "s2_f1",
        "scan",
    ]


def test_zero_padding_may_run_out() -> None:
    assert natural_order(["f100", "f099", "f1000", "f98"], "a") == ["f98", "f099", "f100", "f1000"]


@pytest.mark.parametrize("names", [["frame_1", "frame_001"], ["a2", "A2"], ["0.5", "0.25", "10.5"]])
def test_an_ambiguous_order_is_refused(names: list[str]) -> None:
    with pytest.raises(InputError, match=rf"^here: expected names .* found .*{names[-1]}|{names[0]}"):
        natural_order(names, "here")


def test_decimals_of_equal_length_have_one_order() -> None:
    assert natural_order(["1.25", "0.50", "0.75"], "a") == ["0.50", "0.75", "1.25"]


def test_numbers_in_names_are_compared_as_numbers() -> None:
    names = ["frame_10", "frame_2", "a", "frame_\u00b2", "10", "9"]
    assert sorted(names, key=natural_key) == ["9", "10", "a", "frame_2", "frame_10", "frame_\u00b2"]
