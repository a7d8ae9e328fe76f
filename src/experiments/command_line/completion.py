"""Completion of the words that Hydra does not know: ``+sweep=``, ``doctor``, ``demo``, ``quiet=`` and ``verbose=``.

A shell runs ``ctus -sc query=<shell>`` with what was typed so far in ``COMP_LINE``, as Hydra's scripts for bash, zsh
and fish do. These words are answered without Hydra, and so at once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from experiments.plugins import options_of

_SEPARATORS = {"bash": " ", "zsh": " ", "fish": "\n"}
_WORDS = ("quiet=true", "verbose=true")


def own_completion(words: Sequence[str], environment: Mapping[str, str]) -> str | None:
    """Complete the last word that was typed if it begins one of ours.

    Parameters
    ----------
    words : sequence of str
        Words of the call that the shell made.
    environment : Mapping[str, str]
        Environment of the process.

    Returns
    -------
    str or None
        What the shell is to be told; None where Hydra should answer.
    """
    shell = next((word.removeprefix("query=") for word in words if word.startswith("query=")), "")
    line = environment.get("COMP_LINE")
    if shell not in _SEPARATORS or line is None:
        return None
    found = candidates(line)
    return _SEPARATORS[shell].join(found) if found else None


def candidates(line: str) -> list[str]:
    """List our words that the last word of a line begins.

    Parameters
    ----------
    line : str
        What was typed, with the command's name.

    Returns
    -------
    list of str
        Whole words; ``+sweep=`` alone until that much was typed. Empty where the last word begins none of them.
    """
    typed = line.split(" ")
    last = typed[-1]
    if not last:
        return []
    if last.startswith("+sweep="):
        return [word for name in sorted(options_of("preset")) if (word := f"+sweep={name}").startswith(last)]
    known = ["+sweep=", *_WORDS]
    if len([word for word in typed if word]) == 2:
        known += ["doctor", "demo"]
    return [word for word in known if word.startswith(last)]
