"""Values of a configuration against the annotations of what takes them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol

import pytest

from models.errors import InputError
from models.training.settings import TrainerSettings
from models.value_types import mismatch, parameter_types, require_settings

if TYPE_CHECKING:
    from decimal import Decimal


@dataclass(frozen=True)
class Part:
    """A class whose only field can't be evaluated at run time."""

    price: Decimal
    count: int = 1


class Filter(Protocol):
    def __call__(self) -> None: ...


@pytest.mark.parametrize(
    ("value", "wanted"),
    [
        (3, int),
        (3, float),
        (3.5, float),
        (float("inf"), float),
        (None, int | None),
        ("a", str),
        ("a", Path),
        (True, bool),
        ("b", Literal["a", "b"]),
        ([1, 2.5], Sequence[float]),
        ([1.0, 2.0], tuple[float, float]),
        ([], tuple[str, ...]),
        ({"a": 1}, Mapping[str, int]),
        (0.5, float | Sequence[float] | None),
        ({"a": object()}, Mapping[str, Filter]),
        (TrainerSettings(1, 1, 0.1, 1), TrainerSettings),
        (object(), Any),
    ],
)
def test_a_value_of_the_type_is_taken(value: object, wanted: object) -> None:
    assert mismatch("x", value, wanted) is None


@pytest.mark.parametrize(
    ("value", "wanted", "sentence"),
    [
        (1.5, int, "a.b: expected a whole number, received 1.5"),
        (2.0, int, "a.b: expected a whole number, received 2.0"),
        (True, int, "a.b: expected a whole number, received true"),
        (False, float, "a.b: expected a number, received false"),
        ("1e-3", float, "a.b: expected a number, received '1e-3'"),
        (float("nan"), float, "a.b: expected a number, received nan"),
        (None, int, "a.b: expected a whole number, received null"),
        ("abc", int | None, "a.b: expected a whole number or null, received 'abc'"),
        (1, bool, "a.b: expected true or false, received 1"),
        (7, str, """a.b: expected text, received 7 (as text: a.b='"7"')"""),
        ("c", Literal["a", "b"], "a.b: expected a or b, received 'c'"),
        ("abc", Sequence[str], "a.b: expected a list of texts, received 'abc'"),
        ([1, "x"], Sequence[float], "a.b: expected a list of numbers, received [1, 'x']"),
        ([1.0], tuple[float, float], "a.b: expected a list of 2 (a number, a number), received [1.0]"),
        (3, Mapping[str, Any], "a.b: expected a mapping"),
        (
            3,
            TrainerSettings,
            "a.b: expected the settings of a TrainerSettings (with its _target_), received 3",
        ),
    ],
)
def test_a_value_of_another_type_is_named_with_what_was_expected(
    value: object, wanted: object, sentence: str
) -> None:
    assert (mismatch("a.b", value, wanted) or "").startswith(sentence)


def test_an_object_is_not_plain_data() -> None:
    from models.training.losses import Loss

    assert (
        mismatch("loss", 3, Loss) == "loss: expected the settings of a Loss (with its _target_), received 3"
    )


def test_an_annotation_for_type_checkers_alone_accepts_everything() -> None:
    assert parameter_types(Part) == {"count": int, "return": None}
    require_settings(Part, {"price": "whatever"}, "part")


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"batch_size": 1.5}, "trainer.batch_size: expected a whole number, received 1.5"),
        ({"max_epochs": None}, "trainer.max_epochs: expected a whole number, received null"),
        ({"deterministic": "yes"}, "trainer.deterministic: expected true or false, received 'yes'"),
        ({"epochs": 3}, "trainer: expected settings of TrainerSettings .*received epochs"),
    ],
)
def test_settings_of_a_class_are_checked_before_it_is_made(changes: dict, sentence: str) -> None:
    settings = {"max_epochs": 1, "batch_size": 1, "learning_rate": 1, "patience": 1, **changes}
    with pytest.raises(InputError, match=sentence):
        require_settings(TrainerSettings, settings, "trainer")
    with pytest.raises(InputError, match="expected a value for patience of TrainerSettings, received none"):
        require_settings(TrainerSettings, {"max_epochs": 1, "batch_size": 1, "learning_rate": 1}, "trainer")
