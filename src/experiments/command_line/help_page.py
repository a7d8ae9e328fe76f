"""The help pages, read from the configuration files without Hydra, so that they answer at once."""

from __future__ import annotations

import itertools
import re
import textwrap
from collections.abc import Sequence
from pathlib import Path

from experiments.command_line.options import Choices, chosen, option_text
from experiments.errors import InputError, did_you_mean
from experiments.plugins import config_folders

# The folder of the presets: see experiments.command_line.words on why it is not called sweep.
PRESETS = "preset"

_USAGE = """\
ctus: CT-ultrasound registration of vessels, as tracked experiments

  ctus study=<name> [setting=value ...]            one call, all jobs of the study
  ctus -m study=<name> model=a,b seed=0,1,2 ...    a sweep over every combination
  ctus -m +sweep=<preset> [setting=value ...]      all that a published figure needs
  ctus study=<name> [model=<option> ...] --help    the settings of a study with these options
  ctus doctor                                      what this machine has, what is missing, how to install it
  ctus demo                                        the whole path on simulated data, in about six minutes
"""

_AFTER = """\
Settings of every study
  out=<folder>             where the results go
  resume=true              skip the jobs that have a finished run
  seed=<number>            of every random choice; null where a study makes none
  jobs=<number>            jobs at the same time, each in a process of its own
  launcher=slurm           jobs on a cluster that Slurm runs; slurm_gpu: one GPU a job (docs/launchers.md)
  dry_run=true             check every job and say what it will cost; start none
  quiet=true               say where the files are and no more; verbose=true: all columns, lines with times
  tracking.uri=<address>   an MLflow server; tracking.enabled=false tracks nothing
  --cfg job                print the composed configuration and stop
  --config-dir <folder>    options of your own, in folders named as those of the project
  --version                the version of ctus
  --shell-completion install=bash|zsh|fish   completion for the shell (docs/commands.md)
"""


def help_text(words: Sequence[str]) -> str:
    """Make the help page of the study that a call chooses, or the overview if it chooses none.

    Parameters
    ----------
    words : sequence of str
        Words of the command line; a bare name of a study counts as its choice.

    Returns
    -------
    str
        The page; that of a study has the settings of the chosen options.

    Raises
    ------
    InputError
        If there is no such study or option.
    """
    folders = [*config_folders(), *_own_folders(words)]
    names = list(_options("study", folders))
    # A study's bare name is what somebody types who has not read the overview.
    words = [f"study={word}" if word in names else word for word in words]
    choices = chosen([word for word in words if not word.startswith("-")], folders)
    if choices.study is None:
        return _overview(folders)
    if choices.study not in names:
        raise InputError(
            f"study: expected one of {', '.join(names)}, received {choices.study!r}"
            f"{did_you_mean(choices.study, names)}"
        )
    return _study_page(choices, folders)


def fitted(page: str, width: int = 100) -> str:
    """Break the long lines of a page, so that it fits a terminal.

    Parameters
    ----------
    page : str
        The page.
    width : int, optional
        Longest line.

    Returns
    -------
    str
        The page; text goes on below itself, options at a ``|``, and settings with their comments stay as they are.
    """
    return "\n".join(_fitted(line, width) for line in page.split("\n"))


def _fitted(line: str, width: int) -> str:
    named = re.match(r" +\S.*?\s{2,}(?=\S)", line)
    if len(line) <= width or "#" in line:
        return line
    if "|" in line and named is None:
        indent = " " * (line.index("=") + 1)
        joined = textwrap.fill(
            line.replace("|", " |"), width, subsequent_indent=indent, break_long_words=False
        )
        return joined.replace(" |", "|").replace(f"\n{indent[1:]}|", f"|\n{indent}")
    return textwrap.fill(
        line,
        width,
        subsequent_indent=" " * (len(named[0]) if named else 2),
        break_long_words=False,
        break_on_hyphens=False,
    )


def description(path: Path) -> str:
    """Read what a configuration file says of itself: its first comment that is not a Hydra directive.

    Parameters
    ----------
    path : Path
        Configuration file.

    Returns
    -------
    str
        The comment's text; empty if the file does not begin with one.
    """
    for line in path.read_text(encoding="utf-8").splitlines():
        if line.startswith("#") and "@package" not in line:
            return line.lstrip("# ").strip()
        if line.strip() and not line.startswith("#"):
            break
    return ""


def _overview(folders: Sequence[Path]) -> str:
    paths = _options("study", folders)
    width = max((len(name) for name in paths), default=0)
    studies = "\n".join(f"  {name:<{width}}  {description(path)}" for name, path in paths.items())
    names = sorted({path.name for folder in folders for path in folder.iterdir() if path.is_dir()})
    groups = "\n".join(
        f"  {name}={'|'.join(options)}"
        for name in names
        if name not in ("study", PRESETS) and (options := _options(name, folders))
    )
    presets = "\n".join(
        f"  +sweep={name}  {description(path)}" for name, path in _options(PRESETS, folders).items()
    )
    return f"{_USAGE}\nStudies\n{studies}\n\nPresets\n{presets}\n\nChoices\n{groups}\n\n{_AFTER}"


def _options(group: str, folders: Sequence[Path]) -> dict[str, Path]:
    """The files of a group's options by their names, sorted; the first folder that has one wins, as with Hydra."""
    found = {path.stem: path for folder in reversed(folders) for path in (folder / group).glob("*.yaml")}
    return dict(sorted(found.items()))


def _study_page(choices: Choices, folders: Sequence[Path]) -> str:
    parts = [f"ctus study={choices.study} [setting=value ...]"]
    if choices.preset is not None:
        parts.append(f"# +sweep={choices.preset}\n{option_text('preset', choices.preset, '', folders)}")
    parts.append(option_text("study", str(choices.study), "", folders))
    for group, package, option in choices.options:
        others = _options(group, folders)
        key = group if package == group else f"{group}@{package}"
        parts.append(
            f"# {key}={option}   (of {'|'.join(others)})\n{option_text(group, option, package, folders)}"
        )
    return "\n\n".join(part.rstrip("\n") for part in parts) + f"\n\n{_AFTER}"


def _own_folders(words: Sequence[str]) -> list[Path]:
    """The folder that ``--config-dir`` names, in either spelling."""
    found = [word.partition("=")[2] for word in words if word.startswith("--config-dir=")]
    found += [after for word, after in itertools.pairwise(words) if word in ("--config-dir", "-cd")]
    return [Path(each).expanduser() for each in found]
