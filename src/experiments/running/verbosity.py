"""How much a call says: ``quiet=true`` or ``verbose=true`` among its words.

It is no part of the configuration, for it changes no result: the same job said quietly is the same job. Processes that
a call starts take it over with the environment.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from enum import Enum

from experiments.errors import InputError

VARIABLE = "CTUS_VERBOSITY"


class Verbosity(Enum):
    """What is shown while a call runs and when it ends; what is refused and what failed is always said."""

    QUIET = "quiet"  # where the files are, and nothing else
    NORMAL = "normal"  # bars, one line a stage, tables that fit the terminal, findings
    VERBOSE = "verbose"  # lines with their time, tables with all of their columns


def read_verbosity(words: Sequence[str]) -> tuple[list[str], Verbosity]:
    """Take ``quiet=`` and ``verbose=`` out of the words of a call.

    Parameters
    ----------
    words : sequence of str
        Words of the command line.

    Returns
    -------
    words : list of str
        The other words, in their order.
    level : Verbosity
        What was asked for; where nothing was, what the environment says.

    Raises
    ------
    InputError
        If a value is neither true nor false, or both are true.
    """
    others: list[str] = []
    asked = {}
    for word in words:
        name, separator, value = word.partition("=")
        if name not in ("quiet", "verbose") or not separator:
            others.append(word)
        elif value.lower() not in ("true", "false"):
            raise InputError(f"{name}: expected true or false, received {value!r}")
        else:
            asked[name] = value.lower() == "true"
    if asked.get("quiet") and asked.get("verbose"):
        raise InputError("quiet, verbose: expected one of them to be true, received both")
    if not asked:
        return others, verbosity()
    level = next((each for each in Verbosity if asked.get(each.value)), Verbosity.NORMAL)
    return others, level


def verbosity() -> Verbosity:
    """Read how much is said from the environment.

    Returns
    -------
    Verbosity
        Normal where it says nothing, or nothing known.
    """
    known = {each.value: each for each in Verbosity}
    return known.get(os.environ.get(VARIABLE, ""), Verbosity.NORMAL)


@contextmanager
def saying(level: Verbosity) -> Iterator[None]:
    """Have this process, and those it starts, say so much.

    Parameters
    ----------
    level : Verbosity
        How much.
    """
    before = os.environ.get(VARIABLE)
    os.environ[VARIABLE] = level.value
    try:
        yield
    finally:
        if before is None:
            del os.environ[VARIABLE]
        else:
            os.environ[VARIABLE] = before
