"""The classes that a configuration may name in ``_target_``, and how they are built from it.

A configuration is data from a file, so that it may name data alone: a frozen dataclass that is defined in one of this
project's method packages (``PACKAGES``) or in a plugin. Nothing outside these packages is ever imported for a
configuration, and no function, no other class, and nothing that such a package has from elsewhere is ever called.
"""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Mapping
from types import ModuleType
from typing import Any

from experiments.errors import InputError, did_you_mean
from models.errors import InputError as ModelsInputError
from models.plugins import plugin_packages
from models.value_types import require_settings

# The packages whose frozen dataclasses a configuration may name, in addition to those of plugins.
PACKAGES = ("models", "registration", "experiments.datasets", "experiments.splits")


def build(node: Any, where: str = "config") -> Any:
    """Replace every mapping with a ``_target_`` by the object it describes, depth first; all else stays as it is.

    Parameters
    ----------
    node : Any
        A configuration or a part of one, as plain data.
    where : str, optional
        The dotted place of ``node`` in the configuration, for messages.

    Returns
    -------
    Any
        The object, or ``node`` with the objects in it.

    Raises
    ------
    InputError
        For a ``_target_`` that may not be named, for settings the class does not have, for missing ones, for values of
        another type than the class says, and for those it refuses.
    """
    if isinstance(node, Mapping):
        built = {key: build(value, f"{where}.{key}") for key, value in node.items() if key != "_target_"}
        return _construct(str(node["_target_"]), built, where) if "_target_" in node else built
    if isinstance(node, (list, tuple)):
        return [build(value, f"{where}[{index}]") for index, value in enumerate(node)]
    return node


def load(target: str, where: str = "config") -> type:
    """Import the class that a ``_target_`` names if a configuration may name it.

    Parameters
    ----------
    target : str
        Dotted name of the class: that of a module or package it can be imported from, a dot, its own.
    where : str, optional
        The dotted place in the configuration, for messages.

    Returns
    -------
    type
        The class.

    Raises
    ------
    InputError
        For anything but a frozen dataclass that is defined in ``PACKAGES`` or in a plugin.
    """
    module, _, name = target.rpartition(".")
    plain = all(part.isidentifier() and not part.startswith("_") for part in target.split("."))
    loaded = _imported(module) if plain and _is_ours(module) else None
    found = getattr(loaded, name, None)
    if not _is_method(found):
        known = [other for other, value in vars(loaded).items() if _is_method(value)] if loaded else []
        raise InputError(
            f"{where}._target_: expected a class of this project's registry (a frozen dataclass of "
            f"{', '.join((*PACKAGES, *plugin_packages()))}), received {target!r}{did_you_mean(name, known)}"
        )
    assert isinstance(found, type)
    return found


def _is_ours(module: str) -> bool:
    return any(module == each or module.startswith(f"{each}.") for each in (*PACKAGES, *plugin_packages()))


def _imported(module: str) -> ModuleType | None:
    """The module; none if there is no such one. An import that fails within it is no error of the configuration's."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as missing:
        if missing.name is not None and (module == missing.name or module.startswith(f"{missing.name}.")):
            return None
        raise


def _is_method(found: object) -> bool:
    """Whether a module's attribute is a frozen dataclass that is defined in one of the packages."""
    parameters = vars(found).get("__dataclass_params__") if isinstance(found, type) else None
    return parameters is not None and parameters.frozen and _is_ours(str(found.__module__))


def _construct(target: str, settings: dict[str, Any], where: str) -> Any:
    cls = load(target, where)
    known = inspect.signature(cls).parameters
    hint = next((did_you_mean(name, known) for name in sorted(set(settings) - set(known))), "")
    try:
        require_settings(cls, settings, where)
    except ModelsInputError as refusal:
        raise InputError(f"{refusal}{hint}") from refusal
    try:
        return cls(**settings)
    except (TypeError, ValueError) as refusal:
        raise InputError(f"{where}: {cls.__name__} refused its settings: {refusal}") from refusal
