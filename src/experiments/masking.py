"""Passwords in addresses, which belong in no file, on no page and in no message."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

MASK = "***"
# What stands between the slashes and the last @ before the host; a password may hold a slash, a colon or another @.
_IN_ADDRESS = re.compile(
    r"(?P<scheme>\b[a-z][a-z0-9+.-]*://)(?P<secret>[^\s'\"<>]*@)(?=[\w.\[-])", re.IGNORECASE
)
_IN_QUERY = re.compile(
    r"(?P<name>[?&;](?:password|passwd|pwd|token|secret|api_?key|sslpassword)=)[^&;\s'\"]+", re.IGNORECASE
)


def masked(text: str) -> str:
    """Replace names and passwords of users in all addresses of a text.

    Parameters
    ----------
    text : str
        Any text.

    Returns
    -------
    str
        The text without them.

    Examples
    --------
    >>> masked("tracking.uri=postgresql://me:pass/w@rd@db.example:5432/runs failed")
    'tracking.uri=postgresql://***@db.example:5432/runs failed'
    """
    if "://" not in text and "=" not in text:
        return text
    hidden = _IN_ADDRESS.sub(lambda found: f"{found['scheme']}{MASK}@", text)
    return _IN_QUERY.sub(lambda found: f"{found['name']}{MASK}", hidden)


def masked_values(value: Any) -> Any:
    """Replace them in every text of a configuration.

    Parameters
    ----------
    value : Any
        Plain data: mappings, lists, texts and numbers.

    Returns
    -------
    Any
        A copy with the same structure.
    """
    if isinstance(value, str):
        return masked(value)
    if isinstance(value, Mapping):
        return {key: masked_values(each) for key, each in value.items()}
    return [masked_values(each) for each in value] if isinstance(value, (list, tuple)) else value
