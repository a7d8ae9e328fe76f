"""Settings that are names or paths: text as the user wrote it, before YAML or Hydra takes it for a number.

A group called 1.10 would be held out as 1.1, 1_0 as 10, 010 from a YAML file as 8, 1:30 as 90, and a folder 2024_01
be looked for as 202401. The settings below are known by the last part of their dotted name, wherever they stand.
"""

from __future__ import annotations

import re
from collections.abc import Collection
from typing import Any

import yaml

from experiments.errors import InputError
from registration.errors import InputError as RegistrationInputError
from registration.yaml_nodes import require_small

# Names of groups, sessions, labels, topics and coordinate frames.
NAMES = frozenset(
    {
        "test_groups",
        "selection_groups",
        "test_subjects",
        "session",
        "target",
        "title",
        "register_as",
        "experiments",
        "image_topic",
        "pose_topic",
        "tf_topics",
        "world",
        "ee",
        "image",
        "probe",
        "reference",
        "phantom_frame",
        "image_device",
        "pose_device",
        "host",
        "run",
        "runs",
        "partition",
        "account",
        "qos",
    }
)
PATHS = frozenset(
    {
        "root",
        "cache",
        "file",
        "groups",
        "out",
        "archive",
        "uri",
        "model_path",
        "model_paths",
        "sweep",
        "prediction",
        "masks",
        "input",
        "mesh",
        "ends",
        "calibration",
        "device_set",
        "tracker",
        "results",
        "moving",
        "fixed",
        "initial",
        "moving_landmarks",
        "fixed_landmarks",
        "moving_centerline",
        "fixed_centerline",
        "moving_truth",
        "truth",
        "target_centerline",
        "targets",
        "data_root",
    }
)
TEXT = NAMES | PATHS
# Functions of Hydra's grammar whose arguments are values as they stand.
_PLAIN_FUNCTIONS = ("choice", "shuffle", "sort", "extend_list")
_QUOTED = r"'(?:[^'\\]|\\.)*'|\"(?:[^\"\\]|\\.)*\""
_TOKEN = re.compile(rf"\s*(?:(?P<quoted>{_QUOTED})|(?P<mark>[\[\](),])|(?P<word>[^\[\](),'\"\s]+))\s*")
# What Hydra reads as a number or a truth value.
_NO_TEXT = re.compile(
    r"[+-]?(?:[0-9][0-9_]*)?\.?[0-9_]*(?:e[+-]?[0-9_]+)?|[+-]?(?:inf|nan)|true|false", re.IGNORECASE
)
_NULL = re.compile("null", re.IGNORECASE)


def is_text(key: str) -> bool:
    """Tell whether a setting is a name or a path.

    Parameters
    ----------
    key : str
        Dotted name of the setting, as an override has it.

    Returns
    -------
    bool
        True if the last part of the name is one of ``TEXT``.
    """
    return key.lstrip("+~").rpartition(".")[2] in TEXT


def quoted_override(override: str) -> str:
    """Quote the names in an override of Hydra's grammar that would be read as something else.

    A lone ``null`` stays None; in a list it is a name. Interpolations and settings that are no names stay as
    they are.

    Parameters
    ----------
    override : str
        Override such as ``setting=value``.

    Returns
    -------
    str
        The override with quotes.

    Examples
    --------
    >>> quoted_override("split.test_groups=[1.10,a]")
    "split.test_groups=['1.10',a]"

    Ids of runs are always a list, so that nobody has to say so.

    >>> quoted_override("runs=4fd2,9878")
    "runs=[4fd2,'9878']"
    """
    key, equals, value = override.partition("=")
    if not equals:
        return override
    if key == "runs" and value and "[" not in value and value != "null":
        value = f"[{value}]"
    if is_text(key):
        return f"{key}={_quoted(value)}"
    return f"{key}={_in_dictionaries(value)}" if "{" in value else override


def _quoted(value: str) -> str:
    """A value with its scalars quoted; as it is where it holds what is no plain value."""
    if "{" in value or "$" in value:
        return value
    parts: list[str] = []
    depth = place = 0
    while place < len(value):
        found = _TOKEN.match(value, place)
        if found is None:
            return value
        word, mark = found["word"], found["mark"]
        if word is not None:
            called = value[found.end() : found.end() + 1] == "("
            if called and word not in _PLAIN_FUNCTIONS:
                return value
            # Words with a blank between them are one text.
            alone = place == 0 or value[:place].rstrip()[-1] in "[(,"
            ends = found.end() == len(value) or value[found.end()] in "]),"
            if alone and ends and not called:
                word = _as_text(word, in_list=depth > 0)
            parts += [value[place : found.start("word")], word, value[found.end("word") : found.end()]]
        else:
            parts.append(found.group())
        depth += {"[": 1, "]": -1}.get(mark or "", 0)
        place = found.end()
    return "".join(parts)


def _as_text(word: str, in_list: bool) -> str:
    if _NO_TEXT.fullmatch(word) or (in_list and _NULL.fullmatch(word)):
        return f"'{word}'"
    return word


def _in_dictionaries(value: str) -> str:
    """The same for names in a dictionary, such as ``split={test_groups:[1.10]}``."""
    names = "|".join(sorted(TEXT))
    return re.sub(
        rf"(?P<key>[{{,]\s*(?:{names})\s*:\s*)(?P<value>\[[^\[\]{{}}]*\]|[^\[\]{{}},]+)",
        lambda found: found["key"] + _quoted(found["value"]),
        value,
    )


def fast_loader(loader: type[Any]) -> type[Any]:
    """Make a YAML loader that parses in C where PyYAML was built with libyaml: a fifth of the time to compose a call.

    Parameters
    ----------
    loader : type[Any]
        Loader class in Python, derived from ``yaml.SafeLoader``.

    Returns
    -------
    type[Any]
        The same with the parser in C; ``loader`` itself without libyaml.
    """
    if not yaml.__with_libyaml__:
        return loader
    parser: Any = yaml.CSafeLoader.__mro__[1]

    class Fast(parser, loader):
        def __init__(self, stream: Any) -> None:
            self.name = getattr(stream, "name", "<text>")
            parser.__init__(self, stream)
            yaml.constructor.SafeConstructor.__init__(self)
            yaml.resolver.Resolver.__init__(self)

    return Fast


def loader_with_text(loader: type[Any], settings: Collection[str] = TEXT) -> type[Any]:
    """Make a YAML loader that reads the values of some settings as text, alone or in a list.

    A lone null stays None; in a list it is text. A value that is quoted or has a tag of its own is read as
    before.

    Parameters
    ----------
    loader : type[Any]
        Loader class to derive from.
    settings : Collection[str], optional
        Last parts of the names of these settings.

    Returns
    -------
    type[Any]
        The derived class.
    """

    class Loader(loader):
        def get_single_node(self) -> Any:
            node = super().get_single_node()
            try:
                require_small(node)
            except RegistrationInputError as refusal:
                raise InputError(f"{self.name}: {refusal}") from refusal
            return node

        def construct_mapping(self, node: yaml.Node, deep: bool = False) -> Any:
            for key, value in node.value:
                if isinstance(key, yaml.ScalarNode) and key.value.rpartition(".")[2] in settings:
                    _make_text(value, in_list=False)
            return super().construct_mapping(node, deep=deep)

    return Loader


def _make_text(node: yaml.Node, in_list: bool) -> None:
    if isinstance(node, yaml.SequenceNode):
        for item in node.value:
            _make_text(item, in_list=True)
    elif isinstance(node, yaml.ScalarNode) and (in_list or node.tag != "tag:yaml.org,2002:null"):
        node.tag = "tag:yaml.org,2002:str"
