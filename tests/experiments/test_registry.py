"""The registry: a configuration may name frozen dataclasses of our method packages and of plugins, and nothing else."""

from __future__ import annotations

import importlib
import re
import sys
from dataclasses import dataclass
from types import ModuleType

import pytest
from configurations import CONF

from experiments import registry
from experiments.errors import InputError

TARGETS = sorted(
    {name for path in CONF.rglob("*.yaml") for name in re.findall(r"_target_: ([\w.]+)", path.read_text())}
)
REFUSED = r"rigid\._target_: expected a class of this project's registry"


@dataclass(frozen=True)
class Ball:
    radius_mm: float
    inner: object = None

    def __post_init__(self) -> None:
        if self.radius_mm <= 0:
            raise ValueError(f"radius_mm: expected more than 0, received {self.radius_mm}")


@dataclass
class Loose:
    radius_mm: float = 1.0


class Derived(Ball):
    """Frozen by inheritance, but no dataclass by itself."""


@dataclass(frozen=True)
class Foreign:
    """A frozen dataclass that is defined elsewhere and only imported by a module of ours."""


@pytest.fixture
def shapes(monkeypatch: pytest.MonkeyPatch) -> None:
    """A module ``models.shapes`` with classes of all kinds."""
    module = ModuleType("models.shapes")
    for kind in (Ball, Loose, Derived):
        monkeypatch.setattr(kind, "__module__", "models.shapes")
    for kind in (Ball, Loose, Derived, Foreign):
        setattr(module, kind.__name__, kind)
    module.BALL = Ball(1.0)  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "models.shapes", module)


def test_nested_nodes_are_built_inside_out_and_the_rest_stays(shapes: None) -> None:
    inner = {"_target_": "models.shapes.Ball", "radius_mm": 1}
    node = {"a": [{"_target_": "models.shapes.Ball", "radius_mm": 2.0, "inner": inner}]}
    assert registry.build(node) == {"a": [Ball(2.0, Ball(1))]}


@pytest.mark.parametrize(
    "target",
    [
        "os.system",
        "builtins.eval",
        "subprocess.Popen",
        "modelsevil.Ball",
        "experiments.tracking.Store",
        "experiments.outcome.Outcome",
        "experiments.datasetsevil.Ball",
        "models.shapes.Ball.__init__",
        "models.__builtins__.eval",
        "models._private.Ball",
        "models..shapes.Ball",
        "models",
        "Ball",
        "",
        "models/shapes.Ball",
    ],
)
def test_what_lies_outside_the_packages_is_never_imported(
    target: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(name: str) -> None:
        raise AssertionError(f"{name} was imported")

    monkeypatch.setattr(importlib, "import_module", refuse)
    with pytest.raises(InputError, match=REFUSED):
        registry.build({"_target_": target}, "rigid")


@pytest.mark.parametrize(
    "target",
    [
        "models.shapes.Loose",  # not frozen
        "models.shapes.Derived",
        "models.shapes.Foreign",
        "models.shapes.BALL",  # an object
        "models.shapes.Nothing",
        "models.shapes.Ball.inner",
        "models.nothing.Ball",
        "models.value_types.mismatch",  # a function
        "models.errors.InputError",
        "models.networks.unet.UNetModule",  # a class that is no dataclass
        "models.checkpoint.Path",  # another library's class
        "models.checkpoint.torch",  # a module
        "experiments.datasets.protocol.InputData",  # a dataclass of ours that is no method
    ],
)
def test_what_is_no_frozen_dataclass_of_the_packages_is_refused(shapes: None, target: str) -> None:
    with pytest.raises(InputError, match=REFUSED):
        registry.build({"_target_": target}, "rigid")


def test_an_import_that_fails_inside_a_module_is_not_taken_for_a_wrong_name(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fail(name: str) -> None:
        raise ModuleNotFoundError("No module named 'kiss_matcher'", name="kiss_matcher")

    monkeypatch.setattr(importlib, "import_module", fail)
    with pytest.raises(ModuleNotFoundError, match="kiss_matcher"):
        registry.load("models.shapes.Ball")


def test_a_misspelt_class_is_answered_with_the_right_one(shapes: None) -> None:
    with pytest.raises(InputError, match="did you mean Ball"):
        registry.load("models.shapes.Bal")


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
def test_wrong_settings_are_refused(shapes: None, settings: dict, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        registry.build({"_target_": "models.shapes.Ball", **settings}, "rigid")


@pytest.mark.parametrize("target", TARGETS)
def test_every_class_that_a_configuration_of_ours_names_may_be_named(target: str) -> None:
    assert registry.load(target).__name__ == target.rpartition(".")[2]
