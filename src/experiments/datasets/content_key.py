"""Keys for what was read from files: equal while the files are as they were."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable
from functools import lru_cache, wraps
from pathlib import Path
from typing import Any, TypeVar

Read = TypeVar("Read")


def content_key(paths: Iterable[Path], what: str = "") -> str:
    """Hash the path, size and time of change of files.

    Parameters
    ----------
    paths : iterable of Path
        Files that decide the content, in order. One that is not there counts as such.
    what : str
        What else decides the content, for example the labels to read.

    Returns
    -------
    str
        32 hexadecimal digits.
    """
    digest = hashlib.sha256(what.encode())
    for path in paths:
        try:
            status = path.stat()
            state = f"{status.st_size} {status.st_mtime_ns}"
        except FileNotFoundError:
            state = "missing"
        digest.update(f"{path.absolute()} {state}\n".encode())
    return digest.hexdigest()[:32]


def cached_while_unchanged(
    files: Callable[[Any], Iterable[Path]], maxsize: int = 1
) -> Callable[[Callable[[Any], Read]], Callable[[Any], Read]]:
    """Cache a function of a data set until the settings or the files of the data set change.

    Parameters
    ----------
    files : callable
        The files that decide the result, for a data set; what it raises is passed on.
    maxsize : int
        How many results are kept, those used last.

    Returns
    -------
    callable
        A decorator for functions of one hashable data set.
    """

    def decorate(function: Callable[[Any], Read]) -> Callable[[Any], Read]:
        kept = lru_cache(maxsize=maxsize)(lambda dataset, key: function(dataset))

        @wraps(function)
        def call(dataset: Any) -> Read:
            return kept(dataset, content_key(files(dataset)))

        return call

    return decorate
