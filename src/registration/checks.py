"""Checks of settings that several methods share, each failing with one sentence that names the setting."""

from __future__ import annotations

import math

from registration.errors import InputError


def require_at_least(name: str, value: float, minimum: float) -> None:
    """Raise InputError unless ``value`` is a finite number of at least ``minimum``."""
    if (
        isinstance(value, bool)
        or not isinstance(value, (int, float))
        or not value >= minimum
        or math.isinf(value)
    ):
        raise InputError(f"{name}: expected a number of at least {minimum:g}, received {value!r}")


def require_count(name: str, value: int, minimum: int) -> None:
    """Raise InputError unless ``value`` is a whole number of at least ``minimum``."""
    if isinstance(value, bool) or not isinstance(value, int) or value < minimum:
        raise InputError(f"{name}: expected a whole number of at least {minimum}, received {value!r}")


def require_positive(name: str, value: float, maximum: float = math.inf) -> None:
    """Raise InputError unless ``value`` is a finite number above 0 and at most ``maximum``."""
    if (
        isinstance(value, bool)
        or not isinstance(value, (int, float))
        or not 0 < value <= maximum
        or math.isinf(value)
    ):
        limit = "" if math.isinf(maximum) else f" and at most {maximum:g}"
        raise InputError(f"{name}: expected a number above 0{limit}, received {value!r}")
