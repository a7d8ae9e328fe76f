"""Names of files and cases, equal where a person reads them as equal."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable

from experiments.errors import InputError


def same_name(name: str) -> str:
    """Convert a name that systems write in several ways into one form (Unicode NFC).

    Parameters
    ----------
    name : str
        A name.

    Returns
    -------
    str
        The name in NFC.

    Notes
    -----
    macOS writes an accent as a character of its own (NFD), other systems as part of its letter: both look
    alike.
    """
    return unicodedata.normalize("NFC", name)


def text_names(setting: str, names: Iterable[object]) -> tuple[str, ...]:
    """Check and convert the names that a setting lists.

    Parameters
    ----------
    setting : str
        Name of the setting, for messages.
    names : iterable of object
        Texts or whole numbers; a number is taken as it is written.

    Returns
    -------
    tuple of str
        The names, as ``same_name`` converts them.

    Raises
    ------
    InputError
        If ``names`` is a single text, or a name is of a type that may have been written in another way, such
        as 1.10 that became 1.1.
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
