"""What a configuration that differs from another in one part takes from it: an ablation follows its method.

``${method:multistart.starts.rolls}`` is the value that ``rigid.multistart.starts.rolls`` has in this call, by its file,
a preset or the command line; where that method is not among the chosen ones, it is the value of its file.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

from experiments.errors import InputError
from experiments.plugins import option_file

GROUP = "rigid"


def method_setting(path: str, *, _root_: Any) -> Any:
    """Look up a setting of the rigid methods, as the resolver ``method`` of interpolations.

    Parameters
    ----------
    path : str
        Dotted name: method.setting or method.group.setting.

    Returns
    -------
    Any
        The value as plain data.

    Raises
    ------
    InputError
        If neither the configuration nor the method's file has the setting, or there is no such method.
    """
    from omegaconf import OmegaConf

    method = path.split(".")[0]
    chosen = OmegaConf.select(_root_, GROUP)
    source = chosen if chosen is not None and method in chosen else _by_file(method)
    if not OmegaConf.is_config(source) or not _has(source, path):
        raise InputError(f"{GROUP}: expected a setting {path}, which others follow, found none")
    value = OmegaConf.select(source, path)
    return OmegaConf.to_container(value, resolve=True) if OmegaConf.is_config(value) else value


def _by_file(method: str) -> Any:
    path = option_file(GROUP, method)
    if path is None:
        raise InputError(f"{GROUP}: expected a method {method}, whose settings others follow, found none")
    return _read(path, path.stat().st_mtime_ns)


# An ablation has one interpolation for each of its settings, and each asks for the file.
@lru_cache(maxsize=32)
def _read(path: Path, changed_ns: int) -> Any:
    """The file as it was when it was last changed."""
    from omegaconf import OmegaConf

    return OmegaConf.load(path)


def _has(source: Any, path: str) -> bool:
    """Whether there is such a setting, null or not."""
    from omegaconf import OmegaConf

    group, _, name = path.rpartition(".")
    settings = OmegaConf.select(source, group)
    return OmegaConf.is_dict(settings) and name in settings
