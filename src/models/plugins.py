"""Packages that extend this project without a change to it: those registered under the entry point ``ctus.plugins``.

A plugin's distribution names its package::

    [project.entry-points."ctus.plugins"]
    my_vessels = "my_vessels"

Nothing of a plugin is imported here; where its parts lie is read from the installed distributions.
"""

from __future__ import annotations

import importlib.util
import sys
from functools import lru_cache
from importlib import metadata
from pathlib import Path

from models.errors import InputError

GROUP = "ctus.plugins"


def plugin_packages() -> tuple[str, ...]:
    """Find the packages of all plugins.

    Returns
    -------
    tuple of str
        Dotted names of packages, sorted.
    """
    # A path that was added later may hold more distributions.
    return _packages(tuple(sys.path))


@lru_cache(maxsize=4)
def _packages(path: tuple[str, ...]) -> tuple[str, ...]:
    del path
    return tuple(sorted({entry.value.strip() for entry in metadata.entry_points(group=GROUP)}))


def package_folder(package: str) -> Path:
    """Find the folder of a plugin's package without importing it.

    Parameters
    ----------
    package : str
        Dotted name, as the entry point has it.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    InputError
        If there is no such package.
    """
    try:
        found = importlib.util.find_spec(package)
    except (ImportError, ValueError):
        found = None
    folders = list(found.submodule_search_locations or ()) if found is not None else []
    if not folders:
        raise InputError(f"entry point {GROUP}: expected an installed package, received {package!r}")
    return Path(folders[0])
