"""Whether a value from a configuration is of the type that a parameter is annotated with."""

from __future__ import annotations

import inspect
import math
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from models.errors import InputError

# What YAML and an override can hold themselves; an object of a class comes from a _target_ alone.
PLAIN = (bool, int, float, str, list, tuple, dict)


def parameter_types(function: Callable[..., object] | type) -> dict[str, Any]:
    """Evaluate the annotations of a function's or class's parameters.

    Parameters
    ----------
    function : callable or type
        Function or class.

    Returns
    -------
    dict of str to Any
        Types by parameter. One that can't be evaluated is left out: a name that is imported for type checkers alone
        has no meaning at run time.
    """
    called = function.__init__ if isinstance(function, type) else function  # type: ignore[misc]
    owner = inspect.getmodule(function)
    names = {**vars(typing), **(vars(owner) if owner is not None else {})}
    found = {}
    for name, annotation in getattr(called, "__annotations__", {}).items():
        try:
            found[name] = eval(annotation, names) if isinstance(annotation, str) else annotation
        except (NameError, AttributeError, TypeError):
            continue
    return found


def mismatch(where: str, value: Any, wanted: Any) -> str | None:
    """Describe why a value is not of a type.

    Checked are numbers, text, true and false, choices (``Literal``), None, unions, lists, mappings and this project's
    classes, at any depth; a whole number is a number, true is none, and NaN is none either. Any other annotation
    accepts every value.

    Parameters
    ----------
    where : str
        Name of the setting, for the message.
    value : Any
        Its value.
    wanted : Any
        An annotated type.

    Returns
    -------
    str or None
        A sentence; None if the value is of the type.
    """
    if fits(value, wanted):
        return None
    hint = ""
    if isinstance(value, (int, float)) and str in _alternatives(wanted):
        hint = f""" (as text: {where}='"{value}"')"""
    return f"{where}: expected {describe(wanted)}, received {_shown(value)}{hint}"


def require_settings(target: type, settings: Mapping[str, Any], where: str) -> None:
    """Check that settings are those of a class: all known to it, all it needs, of its types.

    Parameters
    ----------
    target : type
        The class.
    settings : mapping
        Values by name.
    where : str
        What the settings are of, for messages.

    Raises
    ------
    InputError
        If a setting is unknown, missing or of another type.
    """
    known = inspect.signature(target).parameters
    unknown = sorted(set(settings) - set(known))
    if unknown:
        raise InputError(
            f"{where}: expected settings of {target.__name__} ({', '.join(known)}), received {', '.join(unknown)}"
        )
    missing = [
        name
        for name, each in known.items()
        if each.default is inspect.Parameter.empty and name not in settings
    ]
    if missing:
        raise InputError(
            f"{where}: expected a value for {', '.join(missing)} of {target.__name__}, received none"
        )
    types_of = parameter_types(target)
    for name, value in settings.items():
        if (wrong := mismatch(f"{where}.{name}", value, types_of.get(name, Any))) is not None:
            raise InputError(wrong)


def fits(value: Any, wanted: Any) -> bool:
    """Tell whether a value is of an annotated type.

    Parameters
    ----------
    value : Any
        The value.
    wanted : Any
        An annotated type.

    Returns
    -------
    bool
        True if it is.
    """
    return any(_fits_one(value, each) for each in _alternatives(wanted))


def describe(wanted: Any) -> str:
    """Describe an annotated type, as a message needs it after "expected".

    Parameters
    ----------
    wanted : Any
        An annotated type.

    Returns
    -------
    str
        A phrase.
    """
    return " or ".join(dict.fromkeys(_words(each) for each in _alternatives(wanted)))


def _alternatives(wanted: Any) -> tuple[Any, ...]:
    """The members of a union, or the type itself."""
    if typing.get_origin(wanted) in (typing.Union, types.UnionType):
        return tuple(each for member in typing.get_args(wanted) for each in _alternatives(member))
    return (wanted,)


def _fits_one(value: Any, wanted: Any) -> bool:
    origin, arguments = typing.get_origin(wanted) or wanted, typing.get_args(wanted)
    if wanted is None or wanted is type(None):
        return value is None
    if wanted is bool:
        return isinstance(value, bool)
    if wanted is int:
        return isinstance(value, int) and not isinstance(value, bool)
    if wanted is float:
        return isinstance(value, (int, float)) and not isinstance(value, bool) and not math.isnan(value)
    if wanted in (str, Path):
        return isinstance(value, (str, wanted))
    if origin is Literal:
        return any(value == each and type(value) is type(each) for each in arguments)
    if origin in (list, tuple, Sequence):
        return _fits_list(value, origin, arguments)
    if origin in (dict, Mapping):
        return isinstance(value, Mapping) and (
            len(arguments) != 2
            or all(fits(k, arguments[0]) and fits(v, arguments[1]) for k, v in value.items())
        )
    if _is_ours(origin):
        # A protocol can't be told from its class at run time, but plain data is never such an object.
        protocol = getattr(origin, "_is_protocol", False)
        return value is not None and not isinstance(value, PLAIN) if protocol else isinstance(value, origin)
    return True


def _fits_list(value: Any, origin: Any, arguments: tuple[Any, ...]) -> bool:
    if not isinstance(value, (list, tuple)):
        return False
    if not arguments:
        return True
    if origin is tuple and arguments[-1] is not Ellipsis:
        return len(value) == len(arguments) and all(map(fits, value, arguments))
    return all(fits(item, arguments[0]) for item in value)


def _is_ours(wanted: Any) -> bool:
    return isinstance(wanted, type) and wanted.__module__.split(".")[0] in (
        "experiments",
        "models",
        "registration",
    )


def _words(wanted: Any) -> str:
    origin, arguments = typing.get_origin(wanted) or wanted, typing.get_args(wanted)
    simple = {
        type(None): "null",
        None: "null",
        bool: "true or false",
        int: "a whole number",
        float: "a number",
        str: "text",
        Path: "a path",
    }
    if origin is Literal:
        return " or ".join(map(str, arguments))
    if origin in (list, tuple, Sequence):
        if origin is tuple and arguments and arguments[-1] is not Ellipsis:
            return f"a list of {len(arguments)} ({', '.join(describe(each) for each in arguments)})"
        return f"a list of {_plural(arguments[0])}" if arguments else "a list"
    if origin in (dict, Mapping):
        return "a mapping" + (f" of names to {_plural(arguments[1])}" if len(arguments) == 2 else "")
    if _is_ours(origin):
        return f"the settings of a {origin.__name__} (with its _target_)"
    try:
        return simple[wanted]
    except (KeyError, TypeError):
        return str(getattr(wanted, "__name__", wanted))


def _plural(wanted: Any) -> str:
    plain = {int: "whole numbers", float: "numbers", str: "texts"}
    return " or ".join(plain.get(each, _words(each)) for each in _alternatives(wanted))


def _shown(value: Any) -> str:
    if value is None:
        return "null"
    if isinstance(value, bool):
        return str(value).lower()
    return repr(value) if isinstance(value, PLAIN) else f"a {type(value).__name__}"
