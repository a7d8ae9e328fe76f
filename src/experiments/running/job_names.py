"""What jobs are called: labels that differ, folders that no two jobs share, and the choices that tell rows apart."""

from __future__ import annotations

import hashlib
import re
import unicodedata
from collections import Counter
from collections.abc import Mapping

# Longer names of folders are cut.
_LONGEST, _KEPT = 80, 60
_OPENING, _CLOSING = "([{", ")]}"


def distinct_labels(labels: Mapping[str, str]) -> dict[str, str]:
    """The labels of jobs by their hashes, each with the beginning of its hash where two are the same.

    Parameters
    ----------
    labels : Mapping[str, str]
        Label of every job by its hash.

    Returns
    -------
    dict[str, str]
        A label for each hash, all different.
    """
    often = Counter(labels.values())
    return {
        key: label if often[label] == 1 else ",".join(filter(None, (label, f"job={key[:12]}")))
        for key, label in labels.items()
    }


def folder_names(labels: Mapping[str, str]) -> dict[str, str]:
    """A folder's name for each job, by its hash: no two are the same, on any file system.

    A person can read it, a file system takes it, and an override can hold it without quotes.

    Parameters
    ----------
    labels : Mapping[str, str]
        Label of every job by its hash.

    Returns
    -------
    dict[str, str]
        A name for each hash, all different.
    """
    names = {key: _folder_name(label, key) for key, label in labels.items()}
    # Some file systems take upper for lower case, and one form of an accented letter for the other.
    alike = Counter(_folded(name) for name in names.values())
    return {
        key: name if alike[_folded(name)] == 1 else f"{name}_{_digest(labels[key])}"
        for key, name in names.items()
    }


def _folder_name(label: str, key: str) -> str:
    """The label with ``-`` for ``=`` and ``_`` for a comma; by its digest where anything else had to be replaced."""
    readable = label.replace("=", "-").replace(",", "_")
    name = "".join(char if char.isalnum() or char in ".+-_" else "_" for char in readable)
    if not name:
        return key[:12]
    if name != readable or _is_ambiguous(label):
        return f"{name[:_KEPT]}_{_digest(label)}".lstrip("_")
    return name if len(name) <= _LONGEST else f"{name[:_KEPT]}_{_digest(label)}"


def _is_ambiguous(label: str) -> bool:
    """Whether a value could be read as the end of one setting and the beginning of the next: ``x_fold-1``."""
    return any(re.search(r"[=,]|_[\w.]*-", value) for value in choices_of(label).values())


def choices_of(label: str) -> dict[str, str]:
    """The settings in a label such as ``augmentation=strong,parts=[1,2]``, by name.

    Parameters
    ----------
    label : str
        Label of a job.

    Returns
    -------
    dict[str, str]
        Values by setting.
    """
    parts = (part.partition("=") for part in _words(label))
    return {name: value for name, equals, value in parts if equals}


def _words(label: str) -> list[str]:
    """The label cut at its commas, but for those within quotes or brackets."""
    words, word, depth, quote, escaped = [], "", 0, "", False
    for char in label:
        if char == "," and not depth and not quote:
            words.append(word)
            word = ""
            continue
        word += char
        if escaped:
            escaped = False
        elif char == "\\":
            escaped = True
        elif quote:
            quote = "" if char == quote else quote
        elif char in "'\"":
            quote = char
        else:
            depth += (char in _OPENING) - (char in _CLOSING)
    return [*words, word] if word else words


def _folded(name: str) -> str:
    return unicodedata.normalize("NFC", name).casefold()


def _digest(label: str) -> str:
    return hashlib.sha256(label.encode()).hexdigest()[:12]
