"""The options of a call (those that begin with dashes), as opposed to its settings, read in any order."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from experiments.errors import InputError, did_you_mean

SHOWN = ("job", "hydra", "all")
INFORMATION = ("all", "config", "defaults", "defaults-tree", "plugins", "searchpath")


@dataclass(frozen=True)
class CallOptions:
    """What a call asks for.

    Parameters
    ----------
    overrides : tuple of str
        The settings, as words of the form ``setting=value``.
    multirun : bool
        Whether settings with several values are a sweep.
    cfg : str or None
        The part of the configuration to print in place of running: ``job``, ``hydra`` or ``all``.
    package : str or None
        The dotted place in the configuration that is printed; None for all of it.
    resolve : bool
        Whether interpolations are resolved before the configuration is printed.
    info : str or None
        What Hydra is to print of how it composes the configuration.
    hydra_help, shell_completion : bool
        Whether Hydra's own help or the completion for a shell is asked for.
    config_dir : str or None
        The user's own folder of configurations as an absolute path.
    """

    overrides: tuple[str, ...]
    multirun: bool
    cfg: str | None
    package: str | None
    resolve: bool
    info: str | None
    hydra_help: bool
    shell_completion: bool
    config_dir: str | None


def read_options(words: Sequence[str]) -> CallOptions:
    """Read the words of a call, options before, between and after the settings.

    Parameters
    ----------
    words : sequence of str
        The words of the command line.

    Returns
    -------
    CallOptions
        What the call asks for.

    Raises
    ------
    InputError
        For an unknown option, an option without its value, or a ``--config-dir`` that is no folder.
    """
    given = vars(_parser().parse_intermixed_args(list(words)))
    folder = _config_folder(given.pop("config_dir"))
    return CallOptions(overrides=tuple(given.pop("overrides")), config_dir=folder, **given)


class _Parser(argparse.ArgumentParser):
    """A parser whose refusals are one sentence."""

    def error(self, message: str) -> NoReturn:
        if not message.startswith("unrecognized arguments: "):
            raise InputError(message)
        word = message.removeprefix("unrecognized arguments: ").split()[0]
        # These two are answered before the words come here.
        names = ["--help", "--version", *(name for action in self._actions for name in action.option_strings)]
        known = ", ".join(name for name in names if name.startswith("--"))
        raise InputError(
            f"{word}: expected one of {known}, received an unknown one{did_you_mean(word, names)}"
        )


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="ctus", add_help=False)
    parser.add_argument("overrides", nargs="*")
    parser.add_argument("--multirun", "-m", action="store_true")
    parser.add_argument("--cfg", "-c", choices=SHOWN)
    parser.add_argument("--package", "-p")
    parser.add_argument("--resolve", action="store_true")
    parser.add_argument("--info", "-i", const="all", nargs="?", choices=INFORMATION)
    parser.add_argument("--hydra-help", action="store_true")
    parser.add_argument("--shell-completion", "-sc", action="store_true")
    parser.add_argument("--config-dir", "-cd")
    return parser


def _config_folder(config_dir: str | None) -> str | None:
    """The user's own folder of configurations as an absolute path, or None."""
    if config_dir is None:
        return None
    folder = Path(config_dir).expanduser().absolute()
    if not folder.is_dir():
        raise InputError(f"--config-dir: expected a folder of configurations, received {config_dir!r}")
    return str(folder)
