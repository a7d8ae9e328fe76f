"""Names of files and cases: equal where a person reads them as equal, and in the order in which a person counts."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable

from experiments.errors import InputError


def same_name(name: str) -> str:
    """The one form (Unicode NFC) of a name that systems write in several.

    macOS writes an accent as a character of its own (NFD), other systems as part of its letter: both look alike.

    Parameters
    ----------
    name : str
        Name as the project has it.

    Returns
    -------
    str
        The name.
    """
    return unicodedata.normalize("NFC", name)


def text_names(setting: str, names: Iterable[object]) -> tuple[str, ...]:
    """Names from a setting, as ``same_name`` has them.

    A whole number is taken as it is written. Raises InputError for what may have been written in another way, such as
    1.10 that became 1.1, and for a text where several names are expected.

    Parameters
    ----------
    setting : str
        Name of the setting, for messages.
    names : Iterable[object]
        Names as a configuration has them.

    Returns
    -------
    tuple[str, ...]
        The names.
    """
    if isinstance(names, str):
        raise InputError(f"{setting}: expected a list of names, received {names!r}")
    given = tuple(names)
    for name in given:
        if isinstance(name, bool) or not isinstance(name, (str, int)):
            raise InputError(
                f"{setting}: expected names as text, received {name!r} of type {type(name).__name__}; "
                "write the name in quotes"
            )
    return tuple(same_name(str(name)) for name in given)


def natural_key(name: str) -> list[tuple[int, int | str]]:
    """A key to sort by: frame_10 comes after frame_2, and numbers stand before letters.

    Parameters
    ----------
    name : str
        Name as the project has it.

    Returns
    -------
    list[tuple[int, int or str]]
        Key for sorting.
    """
    return [(0, int(part)) if part.isdecimal() else (1, part) for part in re.split(r"(\d+)", name)]
