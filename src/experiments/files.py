"""Writing so that nothing half-written is ever left under a final name."""

from __future__ import annotations

import hashlib
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from experiments.errors import InputError, reading
from registration.io.atomic import atomic_write, partial_name, remove_leftovers

if TYPE_CHECKING:
    import pandas as pd


def write_text(path: Path, text: str) -> None:
    """Write a text file atomically.

    Parameters
    ----------
    path : Path
        File to write; one that exists is replaced.
    text : str
        Content, written as UTF-8.
    """
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


@contextmanager
def staged(folder: Path) -> Iterator[Path]:
    """Give an empty folder whose files are moved to their final place when the block succeeds.

    Files that were in ``folder`` before and are not written again stay. After a failure nothing has changed.

    Parameters
    ----------
    folder : Path
        Final folder; made if it is missing.

    Yields
    ------
    Path
        Temporary folder next to ``folder``.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    remove_leftovers(folder.parent)
    stage = Path(tempfile.mkdtemp(prefix=f"{partial_name(folder.name)}-", dir=folder.parent))
    try:
        yield stage
        for source in sorted(stage.rglob("*")):
            target = folder / source.relative_to(stage)
            if source.is_dir():
                target.mkdir(parents=True, exist_ok=True)
            else:
                target.parent.mkdir(parents=True, exist_ok=True)
                source.replace(target)
        folder.mkdir(parents=True, exist_ok=True)
    finally:
        shutil.rmtree(stage, ignore_errors=True)


def names_in(folder: Path) -> tuple[str, ...]:
    """List every file under a folder.

    Parameters
    ----------
    folder : Path
        The folder.

    Returns
    -------
    tuple of str
        Paths relative to the folder with ``/`` between their parts, sorted.
    """
    found = (path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    return tuple(sorted(found))


def read_table(path: Path, kind: str = "a table of cases", columns: Sequence[str] = ()) -> pd.DataFrame:
    """Read a Parquet file, which may be another's or damaged.

    Parameters
    ----------
    path : Path
        File to read.
    kind : str, optional
        What it must be, with its article, for the message.
    columns : sequence of str, optional
        Columns that it must have.

    Returns
    -------
    pandas.DataFrame
        The table.

    Raises
    ------
    InputError
        If it is no such table; the message names the file.
    """
    import pandas as pd

    with reading(path, kind):
        table = pd.read_parquet(path)
        # Texts are decoded when they are asked for: bytes that are none are to be noticed here.
        for name in table.select_dtypes(exclude="number"):
            table[name].tolist()
    if missing := [column for column in columns if column not in table]:
        raise InputError(f"{path}: expected the columns {', '.join(columns)}, found no {missing[0]}")
    return table


def digest(path: Path) -> str:
    """Compute the SHA-256 of a file's bytes.

    Parameters
    ----------
    path : Path
        File to read.

    Returns
    -------
    str
        Digest in hexadecimal.
    """
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
