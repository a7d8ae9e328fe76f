"""The order of numbered file names: ``frame_10`` comes after ``frame_2``, as a person would sort them."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable

from registration.errors import InputError

_INTEGER = re.compile(r"([0-9]+)")
_DECIMAL = re.compile(r"([0-9]+(?:\.[0-9]+)?)")


def natural_key(name: str) -> tuple[str | int, ...]:
    """Make the key to sort a name by: numbers in it compare as numbers, letters whatever their case.

    Parameters
    ----------
    name : str
        Name of a file.

    Returns
    -------
    tuple of str and int
        Text and numbers in turns, text first, so that like is compared with like.

    Examples
    --------
    >>> sorted(["f10", "F2", "f1"], key=natural_key)
    ['f1', 'F2', 'f10']
    """
    # Text and numbers take turns, text first, so that like is compared with like.
    parts = _INTEGER.split(name.casefold())
    return tuple(int(part) if place % 2 else part for place, part in enumerate(parts))


def natural_order(names: Iterable[str], where: str) -> list[str]:
    """Sort names in their natural order.

    Parameters
    ----------
    names : iterable of str
        Names without suffix.
    where : str
        What the names are of, for messages.

    Returns
    -------
    list of str
        The same names in order.

    Raises
    ------
    InputError
        If the order is ambiguous: two names have the same number (``frame_1`` and ``frame_001``), or numbers
        with a point come in another order when read as decimals (``1.10`` and ``1.9``).
    """
    ordered = sorted(names, key=natural_key)
    for first, second in itertools.pairwise(ordered):
        if natural_key(first) == natural_key(second):
            raise InputError(
                f"{where}: expected names that differ in more than zeros and case, found {first} and {second}"
            )
    by_decimal = sorted(ordered, key=_decimal_key)
    if by_decimal != ordered:
        first = next(name for name, other in zip(ordered, by_decimal, strict=True) if name != other)
        raise InputError(
            f"{where}: expected names in one order, found {first} and others with a point in their numbers, which come "
            "in another order as decimals"
        )
    return ordered


def _decimal_key(name: str) -> tuple[str | float, ...]:
    parts = _DECIMAL.split(name.casefold())
    return tuple(float(part) if place % 2 else part for place, part in enumerate(parts))
