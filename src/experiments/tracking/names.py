"""Names of metrics and parameters as the tracker takes them: few characters, few of them, and still all different."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from typing import Any

LONGEST = 250
_DIGEST_LENGTH = 12
# What the tracker takes on every system but Windows.
_REFUSED = re.compile(r"[^/\w.\- :]")
# It also refuses what a file system would take for another path: no part of a name may be empty or made of dots.
_ODD_PARTS = re.compile(r"(?:^|(?<=/))\.{0,2}(?=/|$)")


def tracked_name(name: str) -> str:
    """A name as the tracker takes it; ``=`` becomes a colon, and where anything else had to go, a digest is added.

    Different names stay different.

    Parameters
    ----------
    name : str
        Name as the project has it.

    Returns
    -------
    str
        The name for the tracker.

    Examples
    --------
    >>> tracked_name("unet augmentation=strong/dsc_mean")
    'unet augmentation:strong/dsc_mean'
    """
    plain = name.replace("=", ":")
    kept = _ODD_PARTS.sub("-", _REFUSED.sub("-", plain))
    # A colon that was one already must not meet one that was an equals sign.
    if kept == plain and ":" not in name and len(kept) <= LONGEST:
        return kept
    digest = hashlib.sha256(name.encode("utf-8", "surrogatepass")).hexdigest()[:_DIGEST_LENGTH]
    return f"{kept[: LONGEST - _DIGEST_LENGTH - 1].rstrip('/')}-{digest}"


def flatten(config: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """One level of dotted keys, as the tracker's parameters want it; an empty mapping or list stays a value.

    Parameters
    ----------
    config : Mapping[str, Any]
        Nested configuration.
    prefix : str, optional
        Dotted name of what holds these keys, with a dot at its end.

    Returns
    -------
    dict[str, Any]
        Values by dotted name.
    """
    flat: dict[str, Any] = {}
    for key, value in config.items():
        dotted = f"{prefix}{key}"
        if isinstance(value, Mapping) and value:
            flat.update(flatten(value, f"{dotted}."))
        else:
            flat[dotted] = value
    return flat
