"""Which options a call chooses, and their settings with the comments on their lines, read without Hydra."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from experiments.errors import InputError, no_such_option

# A line of a configuration that sets something: its indentation and its key.
_KEY = re.compile(r"( *)([\w?]+):(?:\s|$)")


@dataclass(frozen=True)
class Choices:
    """What a call chooses.

    Parameters
    ----------
    study : str or None
        Name of the study; None if none is chosen.
    preset : str or None
        Name of the preset; None if none is chosen.
    options : tuple of tuple[str, str, str], optional
        Group (folder), package (place in the configuration) and option of each choice.
    """

    study: str | None
    preset: str | None
    options: tuple[tuple[str, str, str], ...] = ()


def chosen(words: Sequence[str], folders: Sequence[Path]) -> Choices:
    """Find the choices of a call in addition to those of the defaults.

    Parameters
    ----------
    words : sequence of str
        Words such as ``model=unet``, ``rigid=[a,b]`` or ``+preset=figure``.
    folders : sequence of Path
        Folders of configurations, the project's own first; the first that has a file wins.

    Returns
    -------
    Choices
        The choices; without options if there is no such study.

    Raises
    ------
    InputError
        If there is no such preset.
    """
    asked = {name.lstrip("+"): value for name, _, value in (word.partition("=") for word in words)}
    preset = asked.get("preset")
    defaults: dict[str, Any] = {} if preset is None else _preset_choices(preset, folders)
    study = asked.get("study", defaults.get("study"))
    if study is None or _file("study", study, folders) is None:
        return Choices(study, preset)
    options = []
    for name, default in _defaults(_read("study", study, folders)).items():
        group, _, package = name.partition("@")
        option = asked.get(name, defaults.get(name, default))
        for each in _listed(option):
            options.append((group, package or group, each))
    return replace(Choices(study, preset), options=tuple(options))


def option_text(group: str, option: str, package: str, folders: Sequence[Path]) -> str:
    """Read the settings of an option and of those it is built on, with their comments.

    Parameters
    ----------
    group : str
        Name of the group (folder).
    option : str
        Name of the option.
    package : str
        Dotted place of the settings in the configuration; empty for its top.
    folders : sequence of Path
        Folders of configurations, the project's own first; the first that has a file wins.

    Returns
    -------
    str
        Lines of YAML at their place.

    Raises
    ------
    InputError
        If there is no such option.
    """
    lines = _lines(group, option, folders)
    is_global = "@package _global_" in _read_text(group, option, folders)
    if not package or is_global:
        return "\n".join(lines)
    return "\n".join([f"{package}:", *(f"  {line}" if line else line for line in lines)])


def _lines(group: str, option: str, folders: Sequence[Path]) -> list[str]:
    """An option's lines, laid over those of the options in its defaults."""
    own = _without_defaults(_read_text(group, option, folders).splitlines())
    merged: list[str] = []
    for name, value in _defaults(_read(group, option, folders)).items():
        inner, _, package = name.partition("@")
        # A study's options and those of a preset have sections of their own.
        if group in ("study", "preset"):
            continue
        # "folds" is a file of the same folder, "/phantom/artery" one of another, "recipe@trainer: adamw" one of a
        # folder below, put at "trainer".
        place = inner.removeprefix("/") if inner.startswith("/") else f"{group}/{inner}"
        place, _, chosen_option = (place if value is None else f"{place}/{value}").rpartition("/")
        base = _lines(place, chosen_option, folders)
        merged = _over(merged, [f"{package}:", *(f"  {line}" for line in base)] if package else base)
    return _over(merged, own) if merged else own


def _over(base: list[str], own: list[str]) -> list[str]:
    """``own`` lines over ``base``: a setting of both stands once, with its own line; others follow their block."""
    merged = _placed([line for line in base if not line.startswith("#")])
    heading = [line for line in own if line.startswith("#")]
    for path, line in _placed(own):
        if not path:
            continue
        known = [number for number, (other, _) in enumerate(merged) if other == path]
        if known:
            if not line.rstrip().endswith(":"):
                comment = re.search(r"\s+# .*", merged[known[0]][1])
                merged[known[0]] = (path, line if comment is None or " # " in line else line + comment[0])
            continue
        family = [number for number, (other, _) in enumerate(merged) if other[: len(path) - 1] == path[:-1]]
        merged.insert(family[-1] + 1 if family else len(merged), (path, line))
    return heading + [line for _, line in merged]


def _placed(lines: Sequence[str]) -> list[tuple[tuple[str, ...], str]]:
    """Each line with the keys that lead to it; a comment or a list's line has those of the setting above it."""
    placed: list[tuple[tuple[str, ...], str]] = []
    path: list[tuple[int, str]] = []
    for line in lines:
        found = _KEY.match(line)
        if found is None:
            inside = () if line.startswith("#") else (*(key for _, key in path), line)
            placed.append((inside, line))
            continue
        depth = len(found[1])
        path = [(indent, key) for indent, key in path if indent < depth] + [(depth, found[2])]
        placed.append((tuple(key for _, key in path), line))
    return placed


def _without_defaults(lines: Sequence[str]) -> list[str]:
    """The lines but for the list of defaults and Hydra's directives, which say nothing of settings."""
    kept, inside = [], False
    for line in lines:
        inside = line.startswith("defaults:") or (
            inside and (line.startswith((" ", "-")) or not line.strip())
        )
        if not inside and "@package" not in line:
            kept.append(line)
    return kept


def _defaults(content: Any) -> dict[str, Any]:
    """A file's defaults: what each group (without its slash, with its package) takes; a bare name has None."""
    found: dict[str, Any] = {}
    for entry in content.get("defaults", []) if isinstance(content, dict) else []:
        if isinstance(entry, str) and entry != "_self_":
            found[entry] = None
        elif isinstance(entry, dict):
            found |= {name.removeprefix("override ").lstrip("/"): value for name, value in entry.items()}
    return found


def _preset_choices(preset: str, folders: Sequence[Path]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, value in _defaults(_read("preset", preset, folders)).items():
        found |= _preset_choices(name, folders) if value is None else {name: value}
    return found


def _listed(option: Any) -> list[str]:
    """The options of a choice: one, or those of a list as YAML or as an override writes it."""
    if isinstance(option, str):
        option = [each.strip() for each in option.strip("[]").split(",")]
    return [str(each) for each in option or []]


def _read(group: str, option: str, folders: Sequence[Path]) -> Any:
    return yaml.safe_load(_read_text(group, option, folders)) or {}


def _read_text(group: str, option: str, folders: Sequence[Path]) -> str:
    path = _file(group, option, folders)
    if path is None:
        known = {each.stem for folder in folders for each in (folder / group).glob("*.yaml")}
        raise InputError(no_such_option(group, option, known))
    return path.read_text(encoding="utf-8")


def _file(group: str, option: str, folders: Sequence[Path]) -> Path | None:
    paths = [folder / group / f"{option}.yaml" for folder in folders]
    return next((path for path in paths if path.is_file()), None)
