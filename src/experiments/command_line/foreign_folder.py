"""A folder of configurations that someone else wrote: it chooses settings of studies, and nothing of Hydra's own.

Hydra's own node names classes that it makes while it composes (callbacks, launchers, sweepers), before anything here
could look at them, so the files are looked at before Hydra is.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

from experiments.errors import InputError
from registration.errors import InputError as RegistrationInputError
from registration.text_files import read_text
from registration.yaml_nodes import load_yaml

_PACKAGE = re.compile(r"^\s*#\s*@package\s+(\S+)", re.MULTILINE)
# hydra, hydra.x, /hydra/x, x@hydra.y, override hydra/x.
_OF_HYDRA = re.compile(r"(?:^|[/@\s+~])hydra(?:$|[/.@:=\s])")
# The values of a sweep: words of the command line, which are checked as such.
_ALLOWED = ("sweeper", "params")
_MOST_FILES = 10_000


def require_harmless_folder(folder: Path) -> None:
    """Refuse a folder of configurations that sets anything of Hydra's own but the values of a sweep.

    Parameters
    ----------
    folder : Path
        Folder that ``--config-dir`` names.

    Raises
    ------
    InputError
        If a file lies in Hydra's own group, is put into its node, or sets or chooses something in it.
    """
    for number, (file, group) in enumerate(_files(folder)):
        if number >= _MOST_FILES:
            raise InputError(
                f"--config-dir: expected at most {_MOST_FILES} files of configurations in {folder}"
            )
        if _OF_HYDRA.search(group):
            raise _refusal(file, "a file in Hydra's own group")
        try:
            text = read_text(file)
            content, _ = load_yaml(text)
        except (RegistrationInputError, yaml.YAMLError) as failure:
            reason = str(failure).splitlines()[0]
            raise InputError(f"--config-dir: {file}: expected a YAML file, received {reason}") from failure
        package = _PACKAGE.search(text)
        if package and _OF_HYDRA.search(package[1].replace(".", "/")):
            raise _refusal(file, f"@package {package[1]}")
        if isinstance(content, Mapping):
            _require_harmless(file, content)


def _files(folder: Path) -> Iterator[tuple[Path, str]]:
    """Every file and the group that it lies in, links to folders followed, as Hydra does."""
    seen: set[str] = set()
    for place, folders, names in os.walk(folder, followlinks=True):
        # A folder that links to one above it would never end.
        if os.path.realpath(place) in seen:
            folders.clear()
            continue
        seen.add(os.path.realpath(place))
        group = Path(place).relative_to(folder).as_posix()
        for name in sorted(names):
            if name.endswith((".yaml", ".yml")):
                yield Path(place) / name, group


def _require_harmless(file: Path, content: Mapping[Any, Any]) -> None:
    for choice in _choices(content.get("defaults")):
        if _OF_HYDRA.search(choice):
            raise _refusal(file, choice)
    for key, value in content.items():
        if str(key) != "defaults" and _OF_HYDRA.search(str(key)):
            params = _params(value) if str(key) == "hydra" else None
            if params is None:
                raise _refusal(file, str(key))
            for name, values in params.items():
                if _OF_HYDRA.search(str(name)) or not isinstance(values, (str, int, float, bool)):
                    raise _refusal(file, f"hydra.sweeper.params.{name}")


def _choices(defaults: Any) -> Iterator[str]:
    for entry in defaults if isinstance(defaults, list) else ():
        if isinstance(entry, Mapping):
            for key, value in entry.items():
                yield str(key)
                # The option may name a group as well: /group/option.
                yield from map(str, value if isinstance(value, list) else [value])
        else:
            yield str(entry)


def _params(value: Any) -> Mapping[Any, Any] | None:
    """The values of a sweep where the node sets these alone."""
    for name in _ALLOWED:
        if not isinstance(value, Mapping) or set(value) != {name}:
            return None
        value = value[name]
    return value if isinstance(value, Mapping) else None


def _refusal(file: Path, found: str) -> InputError:
    return InputError(
        f"--config-dir: {file}: expected settings of studies (and values of a sweep under hydra.sweeper.params), "
        f"received {found!r}, which is Hydra's own"
    )
