"""A file of settings in YAML, read by the rules of YAML 1.2, which JSON and most people's expectations follow too.

PyYAML keeps those of version 1.1: there ``1e-3`` is text, ``010`` is eight, ``1_0`` ten, ``1:30`` ninety, ``no`` false.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import yaml

from models.errors import InputError

# A training's settings are some hundred lines.
_LONGEST, _MOST_VALUES = 1 << 20, 100_000


class _CoreLoader(yaml.SafeLoader):
    """The core schema of YAML 1.2 (section 10.3.2) in PyYAML's safe loader; no tag can run any code."""

    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012 - PyYAML copies it before it is changed


_PLAIN_VALUES = (
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("bool", r"true|True|TRUE|false|False|FALSE", list("tTfF")),
    ("int", r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+", list("-+0123456789")),
    (
        "float",
        r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)",
        list("-+0123456789."),
    ),
    ("merge", r"<<", ["<"]),
)
for _name, _pattern, _first in _PLAIN_VALUES:
    _CoreLoader.add_implicit_resolver(f"tag:yaml.org,2002:{_name}", re.compile(f"^(?:{_pattern})$"), _first)


def _whole_number(loader: yaml.SafeLoader, node: yaml.ScalarNode) -> int:
    text = loader.construct_scalar(node)
    return int(text, 0) if text.startswith(("0o", "0x")) else int(text)


_CoreLoader.add_constructor("tag:yaml.org,2002:int", _whole_number)


def parse_settings(text: str) -> Any:
    """Parse a YAML text by the rules of YAML 1.2.

    Parameters
    ----------
    text : str
        YAML.

    Returns
    -------
    Any
        Its content as plain data.

    Raises
    ------
    InputError
        If the text is too long, nested too deep, or its aliases stand for too much.
    """
    if len(text) > _LONGEST:
        raise InputError(f"expected YAML of at most {_LONGEST} characters, received {len(text)}")
    try:
        root = yaml.compose(text, Loader=_CoreLoader)
        if root is not None and _expanded(root, {}) > _MOST_VALUES:
            raise InputError(
                f"expected YAML whose aliases stand for at most {_MOST_VALUES} values, received more"
            )
        return yaml.load(text, Loader=_CoreLoader)
    except RecursionError as error:
        raise InputError("expected YAML of a few levels, received aliases or levels without end") from error


def _expanded(node: yaml.Node, known: dict[int, int]) -> int:
    """How many values a node stands for if every alias is written out."""
    if id(node) not in known:
        below = [each for pair in node.value for each in pair] if isinstance(node, yaml.MappingNode) else []
        below += node.value if isinstance(node, yaml.SequenceNode) else []
        known[id(node)] = 1 + sum(_expanded(each, known) for each in below)
    return known[id(node)]


def read_settings(path: Path) -> dict[str, Any]:
    """Read the mapping in a YAML file.

    Parameters
    ----------
    path : Path
        YAML file.

    Returns
    -------
    dict
        Its content as plain data.

    Raises
    ------
    InputError
        If the file can't be read, holds something else, or has a setting twice.
    """
    try:
        if not path.is_file():
            raise OSError("no file")
        text = path.read_text(encoding="utf-8")
        content, root = parse_settings(text), yaml.compose(text, Loader=_CoreLoader)
    except InputError as refusal:
        raise InputError(f"{path}: {refusal}") from refusal
    except (OSError, ValueError, yaml.YAMLError) as error:
        raise InputError(f"{path}: expected a YAML file with a training's settings, found none") from error
    if not isinstance(content, dict) or root is None:
        raise InputError(f"{path}: expected a YAML mapping, received {type(content).__name__}")
    keys = [str(key.value) for key, _ in root.value] if root is not None else []
    twice = sorted({key for key in keys if keys.count(key) > 1})
    if twice:  # PyYAML takes the last one
        raise InputError(f"{path}: expected each setting once, received {', '.join(twice)} twice")
    return content
