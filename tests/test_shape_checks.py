"""The checks of arrays' shapes behind all other tests: they are there, and see what is wrong."""

from __future__ import annotations

from dataclasses import dataclass

import jaxtyping
import numpy as np
import pytest
import shape_checks
from jaxtyping import Float64

from registration import transforms
from registration.geometry.shapes import Mesh


def check(named: object) -> object:
    return jaxtyping.jaxtyped(typechecker=shape_checks.enforce)(named)


def test_a_function_of_the_packages_refuses_a_wrong_shape() -> None:
    with pytest.raises(jaxtyping.TypeCheckError, match="transforms"):
        transforms.compose(np.zeros((5, 2)))


def test_a_class_of_the_packages_refuses_a_wrong_shape() -> None:
    with pytest.raises(jaxtyping.TypeCheckError):
        Mesh(np.zeros((5, 2)), np.zeros((1, 3), dtype=np.int64))


def test_sizes_have_to_agree_and_what_is_returned_is_checked_too() -> None:
    def halves(
        first: Float64[np.ndarray, "n 3"], second: Float64[np.ndarray, " n"]
    ) -> Float64[np.ndarray, " n"]:
        return second[: len(second) // int(first[0, 0])]

    checked = check(halves)
    assert len(checked(np.ones((4, 3)), np.ones(4))) == 4  # type: ignore[operator]
    for first, second in ((np.ones((4, 3)), np.ones(3)), (2 * np.ones((4, 3)), np.ones(4))):
        with pytest.raises(jaxtyping.TypeCheckError):
            checked(first, second)  # type: ignore[operator]


def test_of_many_calls_the_first_of_each_test_are_checked_and_one_in_so_many_after_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def count(values: Float64[np.ndarray, "n 3"]) -> int:
        return len(values)

    @dataclass
    class Held:
        values: Float64[np.ndarray, "n 3"]

    for made in (check(count), check(Held)):
        for test in (101, 102):
            monkeypatch.setattr(shape_checks.Tests, "number", test)
            refused = []
            for call in range(1, 101):
                try:
                    made(np.zeros((5, 2)))  # type: ignore[operator]
                except jaxtyping.TypeCheckError:
                    refused.append(call)
            assert refused == [*range(1, 33), 48, 64, 80, 96]


def test_what_names_no_array_costs_nothing() -> None:
    def plain(count: int) -> str:
        return "a" * count

    @dataclass
    class Named:
        name: str

    assert check(plain) is plain
    assert check(Named) is Named
