"""Files that the user names: whether they are there and can be read."""

from __future__ import annotations

from pathlib import Path

from registration.errors import InputError
from registration.input_files import read_regular, require_regular


def require_file(path: Path) -> Path:
    """Return the path, or raise InputError unless there is a file that can be opened for reading.

    Parameters
    ----------
    path : Path
        File.

    Returns
    -------
    Path
        The same path.

    Raises
    ------
    InputError
        If there is no such file, it is a folder, a device or a pipe, or it cannot be read.
    """
    path = require_regular(path)
    try:
        path.open("rb").close()
    except OSError as refusal:
        raise InputError(
            f"{path}: expected a file that can be read, received {refusal.strerror}"
        ) from refusal
    return path


def read_bytes(path: Path) -> bytes:
    """Read all of a file.

    Parameters
    ----------
    path : Path
        File.

    Returns
    -------
    bytes
        Its content.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    return read_regular(path)
