"""Text from a user's files: with or without a byte-order mark, and numbers that mean one thing only."""

from __future__ import annotations

import codecs
from pathlib import Path

from registration.errors import InputError
from registration.input_files import LARGEST_TEXT_BYTES, read_regular

_UTF16_MARKS = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


def read_text(path: Path) -> str:
    """Read text in UTF-8, or in UTF-16 if its byte-order mark is that; the mark itself is left out.

    Parameters
    ----------
    path : Path
        File of text.

    Returns
    -------
    str
        Its text.

    Raises
    ------
    InputError
        If the file cannot be read or is not text in either encoding.
    """
    content = read_regular(Path(path), LARGEST_TEXT_BYTES)
    encoding = "utf-16" if content.startswith(_UTF16_MARKS) else "utf-8-sig"
    try:
        return content.decode(encoding)
    except UnicodeDecodeError as refusal:
        raise InputError(f"{path}: expected text in UTF-8, found bytes that are none") from refusal


def parse_number(text: str) -> float:
    """Convert a number written with a decimal point.

    Python alone takes ``1_000`` for a thousand and digits of every script; here they are refused, as commas
    are.

    Parameters
    ----------
    text : str
        Number as written, blanks around it allowed.

    Returns
    -------
    float
        Its value.

    Raises
    ------
    ValueError
        If the text is no such number.

    Examples
    --------
    >>> parse_number(" -5.25e1 ")
    -52.5
    """
    if "_" in text or not text.isascii():
        raise ValueError(f"could not convert string to float: {text!r}")
    return float(text)
