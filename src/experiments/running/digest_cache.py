"""Digests of files, kept by path, size and time of change, so that a large data set is read once, not at each call."""

from __future__ import annotations

import os
import sqlite3
import time
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from experiments import files
from experiments.paths import project_root

# A file that changed so lately may change again within the same tick of its file system's clock.
SETTLED_S = 3.0
# More than SQLite's own five seconds would hold up a call that could as well read the files.
_BUSY_S = 2.0
_TABLE = "CREATE TABLE IF NOT EXISTS file_digests (path TEXT PRIMARY KEY, state TEXT NOT NULL, digest TEXT NOT NULL)"


class DigestCache:
    """SHA-256 of files, kept in the project's cache; within ``with``. Where that can't be written, all are read."""

    def __init__(self) -> None:
        self._place = project_root() / ".cache" / "digests.db"
        self._database: sqlite3.Connection | None = None
        self._fresh: list[tuple[str, str, str]] = []

    def __enter__(self) -> Self:
        if self._place.is_file():
            self._open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        # Made for a digest to keep alone: a call that is refused leaves nothing behind.
        if self._database is None and self._fresh:
            self._open()
        if self._database is None:
            return
        with suppress(sqlite3.Error, UnicodeEncodeError):
            if self._fresh:
                self._database.executemany(
                    "INSERT OR REPLACE INTO file_digests VALUES (?, ?, ?)", self._fresh
                )
            self._database.commit()
        self._database.close()

    def _open(self) -> None:
        with suppress(OSError, sqlite3.Error):
            self._place.parent.mkdir(parents=True, exist_ok=True)
            self._database = sqlite3.connect(self._place, timeout=_BUSY_S)
            self._database.execute(_TABLE)

    def digest(self, path: Path) -> str:
        """SHA-256 of the bytes of a file, in hexadecimal.

        Parameters
        ----------
        path : Path
            File to read.

        Returns
        -------
        str
            The digest.
        """
        stat = path.stat()
        key = os.path.realpath(path)
        state = f"{stat.st_size} {stat.st_mtime_ns} {stat.st_ctime_ns}"
        if (kept := self._kept(key, state)) is not None:
            return kept
        found = files.digest(path)
        if time.time() - max(stat.st_mtime, stat.st_ctime) > SETTLED_S:
            self._fresh.append((key, state, found))
        return found

    def _kept(self, key: str, state: str) -> str | None:
        if self._database is None:
            return None
        with suppress(sqlite3.Error, UnicodeEncodeError):
            row = self._database.execute(
                "SELECT digest FROM file_digests WHERE path = ? AND state = ?", (key, state)
            ).fetchone()
            return None if row is None else str(row[0])
        return None
