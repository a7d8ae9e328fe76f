"""The one exception that says the caller's input is at fault, not the program."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class InputError(ValueError):
    """An argument or a file is not what it must be; the message names it, what was expected and what was found."""


def did_you_mean(word: str, known: Iterable[str], prefix: str = "") -> str:
    """The end of a message on an unknown name: the known one that is spelt most alike, or nothing if none is.

    A dotted name is compared as a whole and by its last part, so that ``batch_sise`` finds ``trainer.batch_size``.
    ``prefix`` stands before the name that is suggested.

    Parameters
    ----------
    word : str
        The unknown name.
    known : Iterable[str]
        Names there are.
    prefix : str, optional
        Text before the suggested name.

    Returns
    -------
    str
        The end of the message; empty if no name is alike.
    """
    names = list(dict.fromkeys(known))
    close = difflib.get_close_matches(word, names, n=1, cutoff=0.6)
    if not close:
        ends = {name.rpartition(".")[2]: name for name in reversed(names)}
        close = [
            ends[end] for end in difflib.get_close_matches(word.rpartition(".")[2], ends, n=1, cutoff=0.75)
        ]
    return f"; did you mean {prefix}{close[0]}?" if close else ""
