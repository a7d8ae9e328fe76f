"""Units of length as headers of volumes spell them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from registration.errors import InputError

# A kilometre in micrometres.
LARGEST = 1e9
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|\binf(?:inity)?\b", re.IGNORECASE)
MM_PER_UNIT = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 1e-3}
_SPELLINGS = {
    "mm": ("mm", "millimeter", "millimetre", "millimeters", "millimetres"),
    "cm": ("cm", "centimeter", "centimetre", "centimeters", "centimetres"),
    "m": ("m", "meter", "metre", "meters", "metres"),
    "um": (
        "um",
        "micron",
        "microns",
        "micrometer",
        "micrometre",
        "micrometers",
        "micrometres",
        "µm",
        "μm",
        "Î¼m",
    ),
}
_UNIT = {spelling: unit for unit, spellings in _SPELLINGS.items() for spelling in spellings}
# What headers write where they know none.
_UNSTATED = {"", "?", "???", "none", "unknown"}


def quoted(text: str) -> list[str]:
    """Split a NRRD field of quoted strings, whose quotes may be missing.

    Parameters
    ----------
    text : str
        Field as it stands in the header.

    Returns
    -------
    list of str
        Its words.
    """
    return re.findall(r'"([^"]*)"', text) or text.split()


def stated_units(words: Sequence[str], field: str, path: Path) -> tuple[str, ...]:
    """Return the unit of each axis, empty where a header states none of them.

    Parameters
    ----------
    words : sequence of str
        Words of the header's field, one an axis.
    field : str
        Name of the field, for messages.
    path : Path
        Name of the file, for messages.

    Returns
    -------
    tuple of str
        Units of length.

    Raises
    ------
    InputError
        If a unit is no length, or the header states the unit of some axes only.
    """
    # Headers are read as Latin-1, in which the micro sign of a UTF-8 file has two characters.
    plain = [word.strip().replace("Â", "") for word in words]
    known = [word for word in plain if word.lower() not in _UNSTATED]
    if not known:
        return ()
    units = [_UNIT.get(word if word in _UNIT else word.lower()) for word in plain]
    if None in units:
        raise InputError(
            f"{path}: expected {field} of {', '.join(MM_PER_UNIT)} for every axis, found {', '.join(plain)}"
        )
    return tuple(str(unit) for unit in units)


def require_plain_lengths(text: str, field: str, path: Path) -> None:
    """Refuse lengths and directions that no volume has: ITK never ends over some of them.

    Parameters
    ----------
    text : str
        Field of a header; what is no number in it is left to others.
    field : str
        Name of the field, for messages.
    path : Path
        Name of the file, for messages.

    Raises
    ------
    InputError
        If a number is infinite or above ``LARGEST``.
    """
    for word in _NUMBER.findall(text):
        if not abs(float(word)) <= LARGEST:
            raise InputError(f"{path}: expected lengths and directions of a volume in {field}, found {word}")
