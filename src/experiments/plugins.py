"""Where configurations and studies come from: this project's own, and those of plugins.

A plugin is a package that an installed distribution registers under the entry point group ``ctus.plugins``. Its folder
``conf`` (package data) holds options in folders named as those of this project, its subpackage ``studies`` holds
studies, and its frozen dataclasses may be a ``_target_`` (see ``experiments.registry``).
"""

from __future__ import annotations

from pathlib import Path

from experiments.errors import InputError
from experiments.paths import conf_dir
from models.errors import InputError as ModelsInputError
from models.plugins import package_folder, plugin_packages

STUDIES = "experiments.studies"


def config_folders() -> list[Path]:
    """List the folders of configurations.

    Returns
    -------
    list of Path
        The project's own folder, then that of each plugin that has one.

    Raises
    ------
    InputError
        If an entry point names no package.
    """
    return [conf_dir(), *plugin_config_folders()]


def plugin_config_folders() -> list[Path]:
    """List the folders of configurations that plugins bring.

    Returns
    -------
    list of Path
        One folder a plugin, in the order of the plugins' names.

    Raises
    ------
    InputError
        If an entry point names no package.
    """
    try:
        folders = [package_folder(package) / "conf" for package in plugin_packages()]
    except ModelsInputError as refusal:
        raise InputError(str(refusal)) from refusal
    return [folder for folder in folders if folder.is_dir()]


def study_packages() -> tuple[str, ...]:
    """List the packages whose modules are studies.

    Returns
    -------
    tuple of str
        Dotted names, the project's own first.
    """
    return STUDIES, *(f"{package}.studies" for package in plugin_packages())


def options_of(group: str) -> list[str]:
    """List the options of a group (a folder of the configuration).

    Parameters
    ----------
    group : str
        Name of the folder.

    Returns
    -------
    list of str
        Names of the options, sorted.
    """
    return sorted({path.stem for folder in config_folders() for path in (folder / group).glob("*.yaml")})


def option_file(group: str, option: str) -> Path | None:
    """Find the file of an option.

    Parameters
    ----------
    group : str
        Name of the folder.
    option : str
        Name of the option.

    Returns
    -------
    Path or None
        The first file of that name; None if there is none.
    """
    paths = (folder / group / f"{option}.yaml" for folder in config_folders())
    return next((path for path in paths if path.is_file()), None)
