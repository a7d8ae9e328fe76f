"""Names of files and cases: equal where a person reads them as equal, and in the order in which a person counts."""

from __future__ import annotations

import re
import unicodedata


def same_name(name: str) -> str:
    """The one form (Unicode NFC) of a name that systems write in several.

    macOS writes an accent as a character of its own (NFD), other systems as part of its letter: both look alike.
    """
    return unicodedata.normalize("NFC", name)


def natural_key(name: str) -> list[tuple[int, int | str]]:
    """A key to sort by: frame_10 comes after frame_2, and numbers stand before letters."""
    return [(0, int(part)) if part.isdecimal() else (1, part) for part in re.split(r"(\d+)", name)]
