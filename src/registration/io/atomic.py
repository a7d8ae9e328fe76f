"""Writing so that a file or a folder stands under its final name only when it is complete."""

from __future__ import annotations

import os
import re
import shutil
import socket
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from registration.errors import InputError

# Which process made a temporary file or folder: the machine's name, so that nobody removes what another one fills.
_OWNER = re.compile(r"^\..*\.partial-(?P<host>[^.]*)-(?P<pid>\d+)(?:-|\.|$)")


def partial_name(name: str) -> str:
    """Return the beginning of a temporary name that says which process it is of.

    Parameters
    ----------
    name : str
        Final name.

    Returns
    -------
    str
        Hidden name with machine and process.
    """
    host = re.sub(r"[^A-Za-z0-9]", "", socket.gethostname()) or "host"
    return f".{name}.partial-{host}-{os.getpid()}"


def remove_leftovers(folder: Path) -> int:
    """Remove what processes of this machine that are gone have left half written in a folder.

    Parameters
    ----------
    folder : Path
        Folder, which need not exist. Folders in it are not entered.

    Returns
    -------
    int
        How many files and folders were removed.
    """
    here, removed = partial_name("").rpartition("-")[0].rpartition("-")[2], 0
    for path in folder.glob(".*.partial-*") if folder.is_dir() else ():
        owner = _OWNER.match(path.name)
        if owner is None or owner["host"] != here or _lives(int(owner["pid"])):
            continue
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)
        removed += 1
    return removed


def _lives(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True
    return True


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Give a temporary path to write to, and rename it to the final one when all went well.

    The temporary name lies in the same folder and keeps the suffix, because many writers choose the format by
    it. What was at ``path`` before stays when writing fails.

    Parameters
    ----------
    path : Path
        Final path; its folder is made if it is absent.

    Yields
    ------
    Path
        Temporary path to write to.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.parent / f"{partial_name(path.stem)}{path.suffix}"
    try:
        yield temporary
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def write_atomic(path: Path, content: bytes) -> None:
    """Write a file atomically.

    Parameters
    ----------
    path : Path
        Path of the file.
    content : bytes
        All of its content.
    """
    with atomic_write(path) as temporary:
        temporary.write_bytes(content)


@contextmanager
def atomic_folder(path: Path) -> Iterator[Path]:
    """Give a temporary folder to fill, and rename it to the final one when all went well.

    Parameters
    ----------
    path : Path
        Final path, which must be absent or an empty folder.

    Yields
    ------
    Path
        Temporary folder.

    Raises
    ------
    InputError
        If there is a file or a folder with content at ``path``.
    """
    if path.exists() and (not path.is_dir() or any(path.iterdir())):
        raise InputError(
            f"{path}: expected a folder that does not exist yet or is empty, found one with content"
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    remove_leftovers(path.parent)
    stage = Path(tempfile.mkdtemp(prefix=f"{partial_name(path.name)}-", dir=path.parent))
    try:
        yield stage
        if path.exists():
            path.rmdir()
        stage.chmod(0o777 & ~_umask())
        stage.replace(path)
    finally:
        shutil.rmtree(stage, ignore_errors=True)


def _umask() -> int:
    """The process's mask for new files, which can only be read by setting it."""
    mask = os.umask(0)
    os.umask(mask)
    return mask
