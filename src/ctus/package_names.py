"""How ``ctus.<package>`` is found: the package itself, also where another one of the same name hides it.

``import ctus.models.metrics`` gives the module ``models.metrics``, one object under two names. But ``models`` may be
another package: a folder of the user's own that comes first in ``sys.path`` or was imported before. Then this project's
files are imported under ``ctus.models`` alone, and what they import of ``models`` is ``ctus.models`` too; the user's
package keeps its name. Python's documentation of ``importlib.abc`` describes the protocol.
"""

from __future__ import annotations

import builtins
import importlib
import importlib.util
import sys
from collections.abc import Mapping, Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from types import ModuleType
from typing import Any

PACKAGES = ("experiments", "models", "registration")
# A package and the others that it imports by their plain names.
_IMPORTS = {"models": ("models",), "registration": ("registration",), "experiments": PACKAGES}
_HOME = Path(__file__).resolve().parents[1]
_PREFIX = "ctus."


def install() -> None:
    """Have Python ask here first for every module below ``ctus``."""
    if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Finder())


class _Finder(MetaPathFinder):
    """Finds modules below ``ctus.models``, ``ctus.registration`` and ``ctus.experiments``."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        del target
        name = fullname.removeprefix(_PREFIX)
        package = name.partition(".")[0]
        if not fullname.startswith(_PREFIX) or package not in PACKAGES:
            return None
        if _loaded_as_own(package) or not all(map(_is_ours, _IMPORTS[package])):
            return _own_spec(fullname, path)
        return ModuleSpec(fullname, _SameModule(name)) if importlib.util.find_spec(name) else None


class _SameModule(Loader):
    """Gives the module of the plain name, whose own attributes stay as they are."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._spec: ModuleSpec | None = None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        module = importlib.import_module(self.name)
        self._spec = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        module.__spec__ = self._spec


class _OwnModule(SourceFileLoader):
    """Runs a file of this project whose imports of ``models`` and the like mean ``ctus.models``."""

    def exec_module(self, module: ModuleType) -> None:
        module.__dict__["__builtins__"] = {**vars(builtins), "__import__": _import_below_ctus}
        super().exec_module(module)


def _import_below_ctus(
    name: str,
    globals: Mapping[str, Any] | None = None,
    locals: Mapping[str, Any] | None = None,
    fromlist: Sequence[str] | None = (),
    level: int = 0,
) -> Any:
    package = name.partition(".")[0]
    if level or package not in PACKAGES:
        return builtins.__import__(name, globals, locals, fromlist or (), level)
    found = builtins.__import__(f"{_PREFIX}{name}", globals, locals, fromlist or (), 0)
    return found if fromlist else sys.modules[f"{_PREFIX}{package}"]


def _own_spec(fullname: str, path: Sequence[str] | None) -> ModuleSpec | None:
    if fullname == f"{_PREFIX}experiments.cli":
        hidden = next(package for package in PACKAGES if not _is_ours(package))
        raise ImportError(
            f"{fullname}: expected the packages that ctus was installed with, found another {hidden!r} that hides "
            f"one of them; start the command ctus instead, which the current folder does not change"
        )
    below = list(path) if fullname.count(".") > 1 and path is not None else [str(_HOME)]
    spec = PathFinder.find_spec(fullname, below)
    if spec is not None and spec.origin is not None:
        spec.loader = _OwnModule(fullname, spec.origin)
    return spec


def _loaded_as_own(package: str) -> bool:
    """Whether the package was imported under ``ctus`` alone: what is below it stays with it."""
    loaded = sys.modules.get(f"{_PREFIX}{package}")
    return loaded is not None and loaded.__name__ != package


def _is_ours(package: str) -> bool:
    """Whether the plain name of a package means the one that lies next to this file."""
    loaded = sys.modules.get(package)
    spec = loaded.__spec__ if loaded is not None else importlib.util.find_spec(package)
    places = spec.submodule_search_locations if spec is not None else None
    return any(Path(place).resolve() == _HOME / package for place in places or ())
