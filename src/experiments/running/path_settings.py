"""Which settings of a configuration name files and folders that a job reads: those whose annotation says so.

A string is never taken for a path because a file of that name happens to exist.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from experiments import registry
from experiments.errors import InputError

_PATH = re.compile(r"\bPath(Setting)?\b")
_LITERAL = re.compile(r"Literal\[([^\]]*)\]")


def named_paths(config: Mapping[str, Any], takers: Sequence[Callable[..., object]]) -> dict[str, str]:
    """The paths that a configuration names, by the dotted place of the setting (``dataset.root``, ``target[1]``).

    ``takers`` are the functions whose parameters are settings of ``config``; the fields of every ``_target_`` in it
    are looked at as well, at any depth.

    Parameters
    ----------
    config : Mapping[str, Any]
        A resolved configuration.
    takers : Sequence[Callable[..., object]]
        Functions whose parameters are settings.

    Returns
    -------
    dict[str, str]
        Paths by the dotted place of their setting.

    Raises
    ------
    InputError
        If a path is empty.
    """
    known = _annotations(takers)
    found: dict[str, str] = {}
    for key, value in config.items():
        if is_path(known.get(str(key), "")):
            found |= dict(_values(value, str(key), words_of(known[str(key)])))
        else:
            found |= dict(_in_parts(value, str(key)))
    return found


def is_path(annotation: object) -> bool:
    """Whether an annotation, as an object or as text, says that a setting is a path to be read.

    Parameters
    ----------
    annotation : object
        Annotation of a parameter, as an object or as text.

    Returns
    -------
    bool
        Whether an annotation, as an object or as text, says that a setting is a path to be read.
    """
    return bool(_PATH.search(_text(annotation)))


def words_of(annotation: object) -> frozenset[str]:
    """The words that a setting takes in place of a path: those of a ``Literal`` in its annotation.

    Parameters
    ----------
    annotation : object
        Annotation of a parameter, as an object or as text.

    Returns
    -------
    frozenset[str]
        The words.
    """
    inside = _LITERAL.findall(_text(annotation))
    return frozenset(word.strip().strip("'\"") for text in inside for word in text.split(","))


def _annotations(takers: Sequence[Callable[..., object]]) -> dict[str, str]:
    """The annotation of every parameter; that of a path wins where two functions share a name."""
    found: dict[str, str] = {}
    for taker in takers:
        for name, parameter in inspect.signature(taker).parameters.items():
            if name not in found or is_path(parameter.annotation):
                found[name] = _text(parameter.annotation)
    return found


def _text(annotation: object) -> str:
    # A class by its own name: its module may be called after paths.
    return annotation if isinstance(annotation, str) else getattr(annotation, "__name__", str(annotation))


def _in_parts(value: Any, place: str) -> Iterator[tuple[str, str]]:
    """The paths in what a configuration builds, and in what holds such parts."""
    if isinstance(value, Mapping):
        made_by = registry.load(str(value["_target_"]), place) if "_target_" in value else None
        fields = _annotations([made_by]) if made_by is not None else {}
        for key, item in value.items():
            annotation = fields.get(str(key), "")
            if made_by is not None and is_path(annotation):
                # A class whose own value is empty has a meaning for it.
                own = inspect.signature(made_by).parameters[str(key)].default
                words = words_of(annotation) | ({""} if own == "" else frozenset())
                yield from _values(item, f"{place}.{key}", words)
            else:
                yield from _in_parts(item, f"{place}.{key}")
    elif isinstance(value, (list, tuple)):
        for number, item in enumerate(value):
            yield from _in_parts(item, f"{place}[{number}]")


def _values(value: Any, place: str, words: frozenset[str]) -> Iterator[tuple[str, str]]:
    if isinstance(value, str) and value not in words:
        if not value.strip():
            # As a path it would be the current folder, whatever lies there.
            raise InputError(
                f"{place}: expected a path, received an empty one (is a variable of the shell not set?)"
            )
        yield place, value
    elif isinstance(value, Mapping):
        for key, item in value.items():
            yield from _values(item, f"{place}.{key}", words)
    elif isinstance(value, (list, tuple)):
        for number, item in enumerate(value):
            yield from _values(item, f"{place}[{number}]", words)
