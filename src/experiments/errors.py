"""The one exception that says the caller's input is at fault, not the program."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from registration import checks, input_files
from registration import errors as registration_errors

# Groups that the command line calls otherwise (command_line.words.read_presets).
CALLED = {"preset": "+sweep"}
_ESCAPED = {code: repr(chr(code))[1:-1] for code in (*range(32), *range(127, 160))}


class InputError(ValueError):
    """An argument or a file is not what it must be; the message names it, what was expected and what was found."""

    def __str__(self) -> str:
        """The message in one line: what it quotes of a file may hold line ends and commands to a terminal."""
        return super().__str__().translate(_ESCAPED)


@contextmanager
def reading(path: Path, kind: str) -> Iterator[None]:
    """Turn whatever a library raises over a file into one sentence that names the file.

    Parameters
    ----------
    path : Path
        File that is read.
    kind : str
        What it must be, with its article.

    Raises
    ------
    InputError
        In place of every other exception but those that speak of this machine (a full disk) or of a stop.
    """
    try:
        with input_files.refusing(path, kind, InputError, user_errors()):
            yield
    except user_errors()[1:] as refusal:
        raise InputError(str(refusal)) from refusal


def require_count(name: str, value: object, minimum: int = 1) -> None:
    """Raise InputError unless a setting is a whole number that is large enough.

    Parameters
    ----------
    name : str
        Name of the setting, for the message.
    value : object
        Its value.
    minimum : int, optional
        Smallest value allowed.

    Raises
    ------
    InputError
        If ``value`` is no whole number (True and False are none) or below ``minimum``.
    """
    try:
        checks.require_count(name, value, minimum)
    except registration_errors.InputError as refusal:
        raise InputError(str(refusal)) from refusal


def user_errors() -> tuple[type[Exception], ...]:
    """The exceptions that mean the user's input is at fault, of every package.

    Returns
    -------
    tuple[type[Exception], ...]
        The classes of exceptions, that of this package first.
    """
    from models import errors as models_errors

    return InputError, registration_errors.InputError, models_errors.InputError


def did_you_mean(word: str, known: Iterable[str], prefix: str = "") -> str:
    """Suggest a known name for an unknown one, as the end of a message.

    A dotted name is compared as a whole and by its last part, so that ``batch_sise`` finds
    ``trainer.batch_size``.

    Parameters
    ----------
    word : str
        The unknown name.
    known : iterable of str
        Names there are.
    prefix : str, optional
        Put before the suggested name.

    Returns
    -------
    str
        Text such as ``; did you mean trainer.batch_size?``; empty if no name is similar enough.
    """
    # Capitals and hyphens are no difference, and a name in full is nearer than one that merely resembles.
    names = {_plain(name): name for name in reversed(list(known))}
    word = _plain(word)
    close = [names[word]] if word in names else []
    close = close or [names[name] for name in difflib.get_close_matches(word, names, n=1, cutoff=0.6)]
    if not close:
        ends = {_plain(name.rpartition(".")[2]): name for name in names.values()}
        close = [
            ends[end] for end in difflib.get_close_matches(word.rpartition(".")[2], ends, n=1, cutoff=0.75)
        ]
    if not close and len(word) > 2:
        close = sorted(name for plain, name in names.items() if plain.startswith(f"{word}_"))
    return f"; did you mean {prefix}{close[0]}?" if close else ""


def _plain(name: str) -> str:
    return name.lower().replace("-", "_")


def no_such_option(group: str, option: object, known: Iterable[str]) -> str:
    """Say that a group has no option of a name.

    Parameters
    ----------
    group : str
        Name of the group as Hydra knows it.
    option : object
        What was given.
    known : iterable of str
        Names of its options.

    Returns
    -------
    str
        The sentence, with the group as the command line writes it.
    """
    names = sorted(known)
    like = did_you_mean(option, names) if isinstance(option, str) else ""
    received = repr(option) if isinstance(option, str) else "null" if option is None else option
    return f"{CALLED.get(group, group)}: expected one of {', '.join(names)}, received {received}{like}"
