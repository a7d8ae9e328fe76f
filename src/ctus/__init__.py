"""``ctus.models``, ``ctus.registration`` and ``ctus.experiments``: the packages of this project under one name.

They are the packages ``models``, ``registration`` and ``experiments`` themselves, so that a class imported by either
name is the same class. Nothing is imported before it is asked for. Where a folder of the user's own is called
``models`` and comes first, ``ctus.models`` is still this project's (``ctus.package_names``).
"""

from __future__ import annotations

import importlib
from types import ModuleType

from ctus.package_names import PACKAGES, install

__all__ = ["experiments", "models", "registration"]

install()


def __getattr__(name: str) -> ModuleType:
    """Import one of the packages when it is first asked for."""
    if name not in PACKAGES:
        raise AttributeError(f"module 'ctus' has no attribute {name!r}")
    return importlib.import_module(f"ctus.{name}")


def __dir__() -> list[str]:
    """Names of the packages next to what is there already."""
    return sorted({*globals(), *PACKAGES})
