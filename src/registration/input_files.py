"""Files of anyone's, before any library sees them: regular files of bounded size, and every failure one sentence.

A file may be broken, or made to hurt: a device that never ends, a pipe that nobody writes to, a header that names
``/etc/passwd`` or promises two billion voxels, three megabytes that unpack to four gigabytes. What is checked here
holds for every reader.
"""

from __future__ import annotations

import errno
import functools
import re
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import Concatenate, ParamSpec, TypeVar

from registration.errors import InputError

# Text is read whole and parsed in Python; numbers are read whole too, but take no more memory than the file.
LARGEST_TEXT_BYTES = 1 << 28
LARGEST_FILE_BYTES = 1 << 34
# Deflate packs zeros 1 032 times at most. Voxels beyond the first size may be packed by no more than the factor, so
# that a small file cannot ask for much memory: label maps are packed by hundreds, frames and scans by tens.
FREE_UNPACKED_BYTES = 1 << 30
LARGEST_FACTOR = 100
# Failures of this machine, of which the file is innocent.
_NOT_THE_FILE = (errno.ENOSPC, errno.EDQUOT, errno.EMFILE, errno.ENFILE, errno.EROFS)
_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISSOCK, "a socket"),
)
_DRIVE = re.compile(r"^[A-Za-z]:")
_LONGEST_REASON = 160

Rest = ParamSpec("Rest")
Found = TypeVar("Found")


def require_regular(path: Path, largest: int = LARGEST_FILE_BYTES) -> Path:
    """Return the path of a regular file; devices, pipes and sockets are never opened.

    Parameters
    ----------
    path : Path
        File, or a link to one.
    largest : int, optional
        Largest size in bytes.

    Returns
    -------
    Path
        The same path.

    Raises
    ------
    InputError
        If there is none, it is something else, or it is larger.
    """
    path = Path(path)
    try:
        status = path.stat()
    except (OSError, ValueError) as failure:
        nothing = isinstance(failure, (FileNotFoundError, NotADirectoryError))
        found = "nothing there" if nothing else str(getattr(failure, "strerror", None) or failure)
        raise InputError(f"{path}: expected a file, received {found}") from failure
    if not stat.S_ISREG(status.st_mode):
        found = next((name for is_kind, name in _KINDS if is_kind(status.st_mode)), "no regular file")
        raise InputError(f"{path}: expected a file, received {found}")
    if status.st_size > largest:
        raise InputError(
            f"{path}: expected a file of at most {largest} bytes, received {status.st_size} bytes"
        )
    return path


def read_regular(path: Path, largest: int = LARGEST_FILE_BYTES) -> bytes:
    """Read all of a regular file.

    Parameters
    ----------
    path : Path
        File.
    largest : int, optional
        Largest size in bytes.

    Returns
    -------
    bytes
        Its content.

    Raises
    ------
    InputError
        If there is no regular file of that size, or it cannot be read.
    """
    try:
        return require_regular(path, largest).read_bytes()
    except OSError as failure:
        raise InputError(
            f"{path}: expected a readable file, found {failure.strerror or failure}"
        ) from failure


def beside(path: Path, name: str) -> Path:
    """Return the file of a name that stands in another file: in the same folder or below it, nowhere else.

    Parameters
    ----------
    path : Path
        File that the name stands in.
    name : str
        Name, which may be of a file in a folder below.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InputError
        If the name is an absolute path or leads upwards.

    Examples
    --------
    >>> beside(Path("scan/a.mhd"), "a.raw").as_posix()
    'scan/a.raw'
    """
    plain = PurePosixPath(name.replace("\\", "/"))
    if not name.strip() or "\0" in name or plain.is_absolute() or ".." in plain.parts or _DRIVE.match(name):
        raise InputError(f"{path}: expected the name of a file in its own folder, received {name[:80]!r}")
    return path.parent / name


def require_unpacked_size(size: int, packed: int, path: Path | str) -> None:
    """Refuse data that would take far more memory than the file that they are packed in.

    Parameters
    ----------
    size : int
        Bytes when unpacked, as the header says.
    packed : int
        Bytes that there are.
    path : Path or str
        Name of the file, for messages.

    Raises
    ------
    InputError
        If the factor is one that no recording has.
    """
    if size > max(FREE_UNPACKED_BYTES, LARGEST_FACTOR * packed):
        raise InputError(
            f"{path}: expected at most {LARGEST_FACTOR} times its {packed} packed bytes "
            f"(or {FREE_UNPACKED_BYTES} bytes), received a header that promises {size} bytes"
        )


@contextmanager
def refusing(
    path: Path | str,
    kind: str,
    error: type[Exception] = InputError,
    passing: tuple[type[Exception], ...] = (InputError,),
) -> Iterator[None]:
    """Turn whatever a library raises over a file into one sentence that names the file.

    Parameters
    ----------
    path : Path or str
        Name of the file.
    kind : str
        What the file must be, with its article.
    error : type, optional
        Exception that is raised.
    passing : tuple of type, optional
        Exceptions that say it well already; one that does not name the file gets its name.

    Raises
    ------
    InputError
        In place of every other exception but those that speak of this machine (a full disk) or of a stop.
    """
    try:
        yield
    except passing as refusal:
        if str(path) in str(refusal):
            raise
        raise type(refusal)(f"{path}: {refusal}") from refusal
    except Exception as failure:
        if isinstance(failure, OSError) and failure.errno in _NOT_THE_FILE:
            raise
        raise error(
            f"{path}: expected {kind}, received a file that can't be read as one ({reason(failure)})"
        ) from failure


def guarded(
    kind: str, largest: int = LARGEST_FILE_BYTES
) -> Callable[[Callable[Concatenate[Path, Rest], Found]], Callable[Concatenate[Path, Rest], Found]]:
    """Guard the one function through which files of a kind are read: its first argument is the file.

    Parameters
    ----------
    kind : str
        What the file must be, with its article.
    largest : int, optional
        Largest size in bytes.

    Returns
    -------
    callable
        Decorator. The function sees regular files of that size alone, and raises InputError alone.
    """

    def wrap(read: Callable[Concatenate[Path, Rest], Found]) -> Callable[Concatenate[Path, Rest], Found]:
        @functools.wraps(read)
        def reading(path: Path, /, *rest: Rest.args, **named: Rest.kwargs) -> Found:
            with refusing(path, kind):
                return read(require_regular(Path(path), largest), *rest, **named)

        return reading

    return wrap


def reason(failure: BaseException) -> str:
    """Return the first line of an exception's message, cut to a length that fits a sentence.

    Parameters
    ----------
    failure : BaseException
        Exception.

    Returns
    -------
    str
        Its class, and its message where it has one.
    """
    lines = (
        str(failure).strip().splitlines() if not isinstance(failure, RecursionError) else ["nested too deep"]
    )
    return ": ".join([type(failure).__name__, *lines[:1]])[:_LONGEST_REASON]
