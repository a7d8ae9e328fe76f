"""Writing so that a file stands under its final name only when it is complete.

``registration.io.atomic`` has the same few lines: the two packages do not import each other.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Write a file atomically: give a temporary name in its folder, renamed to ``path`` when all went well.

    The temporary name keeps the suffix, because many writers choose the format by it. What was at ``path`` before
    stays when writing fails.

    Parameters
    ----------
    path : Path
        Final name of the file; its folder is made.

    Yields
    ------
    Path
        Temporary name to write to.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.parent / f".{path.stem}.partial-{os.getpid()}{path.suffix}"
    try:
        yield temporary
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
