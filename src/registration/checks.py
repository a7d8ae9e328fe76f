"""Checks of settings that several methods share, each failing with one sentence that names the setting."""

from __future__ import annotations

import math
from collections.abc import Iterable

from registration.errors import InputError


def require_at_least(name: str, value: object, minimum: float) -> None:
    """Raise InputError unless a setting is a finite number that is large enough.

    Parameters
    ----------
    name : str
        Name of the setting, for the message.
    value : object
        Its value.
    minimum : float
        Smallest value allowed.

    Raises
    ------
    InputError
        If ``value`` is no number, NaN, infinite or below ``minimum``.
    """
    if (
        isinstance(value, bool)
        or not isinstance(value, (int, float))
        or not value >= minimum
        or math.isinf(value)
    ):
        raise InputError(f"{name}: expected a number of at least {minimum:g}, received {value!r}")


def require_count(name: str, value: object, minimum: int) -> None:
    """Raise InputError unless a setting is a whole number that is large enough.

    Parameters
    ----------
    name : str
        Name of the setting, for the message.
    value : object
        Its value.
    minimum : int
        Smallest value allowed.

    Raises
    ------
    InputError
        If ``value`` is no whole number (True and False are none) or below ``minimum``.
    """
    if isinstance(value, bool) or not isinstance(value, int) or value < minimum:
        raise InputError(f"{name}: expected a whole number of at least {minimum}, received {value!r}")


def require_positive(name: str, value: object, maximum: float = math.inf) -> None:
    """Raise InputError unless a setting is a finite number above 0.

    Parameters
    ----------
    name : str
        Name of the setting, for the message.
    value : object
        Its value.
    maximum : float, optional
        Largest value allowed.

    Raises
    ------
    InputError
        If ``value`` is no number, NaN, infinite, 0 or less, or above ``maximum``.
    """
    if (
        isinstance(value, bool)
        or not isinstance(value, (int, float))
        or not 0 < value <= maximum
        or math.isinf(value)
    ):
        limit = "" if math.isinf(maximum) else f" and at most {maximum:g}"
        raise InputError(f"{name}: expected a number above 0{limit}, received {value!r}")


def require_positive_each(name: str, values: Iterable[float], each: str) -> tuple[float, ...]:
    """Return several numbers above 0, or raise InputError unless there is one at least and all are.

    Parameters
    ----------
    name : str
        Name of the setting, for the message.
    values : iterable of float
        Its values; a configuration file hands over a list.
    each : str
        What one of them is, for the message.

    Returns
    -------
    tuple of float
        The values.

    Raises
    ------
    InputError
        If there is none, or one is no finite number above 0.
    """
    found = tuple(values)
    if not found:
        raise InputError(f"{name}: expected at least one {each}, received none")
    for value in found:
        require_positive(name, value)
    return found
