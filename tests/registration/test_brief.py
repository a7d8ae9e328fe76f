"""What results say of themselves: arrays by shape, lists by length, one screen whatever they hold."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from registration.brief import COLUMNS, brief_repr, brief_value


@dataclass(frozen=True)
class Small:
    points_mm: np.ndarray
    names: tuple[str, ...] = ()
    hidden: Any = field(default=None, repr=False)

    __repr__ = brief_repr


@dataclass(frozen=True)
class Large:
    small: Small
    text: str
    numbers: tuple[float, ...]
    by_name: dict[str, float]
    table: Any = None

    __repr__ = brief_repr


def test_what_fits_is_one_line() -> None:
    assert (
        repr(Small(np.zeros((1000, 3)), ("a", "b"))) == "Small(points_mm=(1000, 3) float64, names=('a', 'b'))"
    )


def test_a_few_numbers_are_told_and_many_counted() -> None:
    assert brief_value(np.array([1.0, 2.5])) == "[1, 2.5]"
    assert brief_value(np.arange(7)) == "(7,) int64"
    assert brief_value(tuple(range(40))) == "40 entries"
    assert brief_value(()) == "0 entries"
    assert brief_value({"a": 1.23456789}) == "{a: 1.235}"
    assert brief_value({str(number): 1.0 for number in range(50)}) == "50 entries"
    assert brief_value(float("nan")) == "nan"
    # A scalar of numpy has a shape too, of no axes.
    assert brief_value(np.float64(0.25)) == "0.25"


def test_what_does_not_fit_has_a_line_a_field_that_is_cut() -> None:
    made = Large(Small(np.zeros(9)), "word " * 200, (1.0, 2.0), dict.fromkeys(map(str, range(99)), 0.0))
    lines = repr(made).splitlines()
    assert lines[0] == "Large(" and lines[-1] == "    table=None)"
    assert len(lines) == 6
    assert max(map(len, lines)) <= COLUMNS
    assert "by_name=99 entries" in repr(made) and "..." in lines[2]


def test_fields_that_are_not_to_be_shown_are_left_out() -> None:
    assert "secret" not in repr(Small(np.zeros(2), hidden="secret"))
