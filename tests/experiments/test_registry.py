"""The registry: only what it names is built, and a wrong setting is said in one sentence."""

from __future__ import annotations

import importlib
from dataclasses import dataclass

import pytest

from experiments import registry
from experiments.errors import InputError


@dataclass(frozen=True)
class Ball:
    radius_mm: float
    inner: object = None

    def __post_init__(self) -> None:
        if self.radius_mm <= 0:
            raise ValueError(f"radius_mm: expected more than 0, received {self.radius_mm}")


@pytest.fixture(autouse=True)
def with_ball(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "ALLOWED", frozenset({"shapes.Ball"}))
    module = type("Module", (), {"Ball": Ball})
    monkeypatch.setattr(importlib, "import_module", lambda name: module)


def test_nested_nodes_are_built_inside_out_and_the_rest_stays() -> None:
    node = {
        "a": [
            {
                "_target_": "shapes.Ball",
                "radius_mm": 2.0,
                "inner": {"_target_": "shapes.Ball", "radius_mm": 1},
            }
        ]
    }
    assert registry.build(node) == {"a": [Ball(2.0, Ball(1))]}


@pytest.mark.parametrize("target", ["os.system", "builtins.eval", "shapes.Ball.__init__", ""])
def test_what_is_not_registered_is_never_imported(target: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(name: str) -> None:
        raise AssertionError(f"{name} was imported")

    monkeypatch.setattr(importlib, "import_module", refuse)
    with pytest.raises(InputError, match=r"rigid\._target_: expected a class of this project's registry"):
        registry.build({"_target_": target}, "rigid")


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        (
            {"radius_mm": 1, "colour": "red"},
            r"rigid: expected settings of Ball \(radius_mm, inner\), received colour",
        ),
        ({}, "rigid: expected a value for radius_mm of Ball, received none"),
        ({"radius_mm": -1}, "rigid: Ball refused its settings: radius_mm: expected more than 0, received -1"),
    ],
)
def test_wrong_settings_are_refused(settings: dict, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        registry.build({"_target_": "shapes.Ball", **settings}, "rigid")


def test_every_registered_name_exists(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    assert registry.ALLOWED
    for target in registry.ALLOWED:
        assert isinstance(registry.load(target), type)
