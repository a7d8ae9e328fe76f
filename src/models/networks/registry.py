"""The networks there are, by the name under which a checkpoint finds the recipe of its own."""

from __future__ import annotations

import dataclasses
import importlib
import pkgutil
from collections.abc import Iterator, Mapping
from functools import lru_cache
from types import ModuleType
from typing import Any, ClassVar, Protocol, runtime_checkable

from torch import nn

from models.errors import InputError
from models.plugins import plugin_packages
from models.value_types import require_settings


@runtime_checkable
class NetworkRecipe(Protocol):
    """Frozen dataclass of plain settings whose call builds a network, images (b, 1, h, w) to logits alike.

    In training mode a network may return ``models.networks.outputs.SideOutputs`` instead.
    """

    name: ClassVar[str]

    @property
    def multiple(self) -> int:
        """Number that both sides of an image must be multiples of."""
        ...

    def __call__(self) -> nn.Module:
        """Build the network with weights drawn from torch's current seed.

        Returns
        -------
        nn.Module
            Images (b, 1, h, w) to logits (b, 1, h, w).
        """
        ...


def recipes() -> dict[str, type[Any]]:
    """Find the recipes of all networks: those of the modules of this package and of each plugin's ``networks``.

    Returns
    -------
    dict of str to type
        The classes by their ``name``.

    Raises
    ------
    InputError
        If two networks have one name.
    """
    return _recipes((__package__, *(f"{plugin}.networks" for plugin in plugin_packages())))


@lru_cache(maxsize=4)
def _recipes(packages: tuple[str, ...]) -> dict[str, type[Any]]:
    found: dict[str, type[Any]] = {}
    for module in (module for package in packages for module in _modules(package)):
        for value in vars(module).values():
            if not _is_recipe(value, module):
                continue
            if value.name in found:
                raise InputError(
                    f"network: expected one network of each name, received {value.name!r} of "
                    f"{found[value.name].__module__} and {module.__name__}"
                )
            found[value.name] = value
    return found


def _modules(package: str) -> Iterator[ModuleType]:
    try:
        top = importlib.import_module(package)
    except ModuleNotFoundError as missing:
        if missing.name == package:  # a plugin need not have networks
            return
        raise
    yield top
    for entry in pkgutil.iter_modules(getattr(top, "__path__", ())):
        yield importlib.import_module(f"{package}.{entry.name}")


def _is_recipe(value: object, module: ModuleType) -> bool:
    """Whether a module's attribute is the recipe of a network that the module itself defines."""
    return (
        isinstance(value, type)
        and value.__module__ == module.__name__
        and dataclasses.is_dataclass(value)
        and isinstance(getattr(value, "name", None), str)
        and hasattr(value, "multiple")
    )


def settings_of(recipe: NetworkRecipe) -> dict[str, Any]:
    """Return the fields of a recipe as plain values.

    Parameters
    ----------
    recipe : NetworkRecipe
        Architecture.

    Returns
    -------
    dict
        Values by name.
    """
    settings = dataclasses.asdict(recipe)  # type: ignore[call-overload]
    return dict(settings)


def recipe_of(name: str, settings: Mapping[str, Any]) -> NetworkRecipe:
    """Build a recipe from its name and settings.

    Parameters
    ----------
    name : str
        One of ``recipes()``.
    settings : mapping
        Fields of the recipe.

    Returns
    -------
    NetworkRecipe
        The recipe.

    Raises
    ------
    InputError
        If the name is unknown or the settings are refused.
    """
    known = recipes()
    if name not in known:
        raise InputError(f"network: expected one of {', '.join(sorted(known))}, received {name!r}")
    try:
        require_settings(known[name], settings, name)
    except InputError as refusal:
        raise InputError(f"network: expected settings of {name}, received others ({refusal})") from refusal
    recipe: NetworkRecipe = known[name](**settings)
    return recipe
