"""What a configuration that differs from another in one part takes from it: an ablation follows its method.

``${method:multistart.rolls}`` is the value that ``rigid.multistart.rolls`` has in this call, by its file, a preset or
the command line; where that method is not among the chosen ones, it is the value of its file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import yaml

from experiments.errors import InputError
from experiments.paths import conf_dir

GROUP = "rigid"


def method_setting(path: str, *, _root_: Mapping[str, Any]) -> Any:
    """The setting ``path`` (method.setting) of the rigid methods as plain data; ``_root_`` is the whole configuration.

    Raises InputError for a setting that neither the configuration nor the method's file has.
    """
    method, _, setting = path.partition(".")
    chosen = _root_.get(GROUP) or {}
    settings = chosen[method] if method in chosen else _by_file(method)
    if setting not in settings:
        raise InputError(f"{GROUP}: expected a setting {path}, which others follow, found none")
    return _plain(settings[setting])


def _by_file(method: str) -> Mapping[str, Any]:
    text = (conf_dir() / GROUP / f"{method}.yaml").read_text(encoding="utf-8")
    settings: Mapping[str, Any] = yaml.safe_load(text)[method]
    return settings


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(inner) for key, inner in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_plain(inner) for inner in value]
    return value
