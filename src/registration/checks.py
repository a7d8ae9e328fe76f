"""Checks of settings that several methods share, each failing with one sentence that names the setting."""

from __future__ import annotations

import math

from registration.errors import InputError


def require_at_least(name: str, value: float, least: float) -> None:
    """Raise InputError unless ``value`` is a finite number of at least ``least``."""
    if (
        isinstance(value, bool)
        or not isinstance(value, (int, float))
        or not value >= least
        or math.isinf(value)
    ):
        raise InputError(f"{name}: expected a number of at least {least:g}, received {value!r}")


def require_count(name: str, value: int, least: int) -> None:
    """Raise InputError unless ``value`` is a whole number of at least ``least``."""
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise InputError(f"{name}: expected a whole number of at least {least}, received {value!r}")


def require_positive(name: str, value: float, most: float = math.inf) -> None:
    """Raise InputError unless ``value`` is a finite number above 0 and at most ``most``."""
    if (
        isinstance(value, bool)
        or not isinstance(value, (int, float))
        or not 0 < value <= most
        or math.isinf(value)
    ):
        limit = "" if math.isinf(most) else f" and at most {most:g}"
        raise InputError(f"{name}: expected a number above 0{limit}, received {value!r}")
