"""Zip archives, as torch and NumPy write them, whose sums fit and that do not unpack to far more than they are."""

from __future__ import annotations

import zipfile
from pathlib import Path

# A file may unpack to this many bytes, and beyond them to so many times its own size.
FREE_BYTES, LARGEST_FACTOR = 1 << 30, 100


def require_whole_archive(path: Path) -> None:
    """Check the sum of every file in an archive, which neither torch nor NumPy looks at.

    Parameters
    ----------
    path : Path
        Archive.

    Raises
    ------
    OSError
        If there is no regular file.
    zipfile.BadZipFile
        If it is no archive, a sum does not fit, or it unpacks to more than any file of this program does.

    Examples
    --------
    >>> require_whole_archive(Path("absent.npz"))
    Traceback (most recent call last):
        ...
    FileNotFoundError: [Errno 2] no regular file: 'absent.npz'
    """
    if not path.is_file():
        raise FileNotFoundError(2, "no regular file", str(path))
    with zipfile.ZipFile(path) as archive:
        unpacked = sum(entry.file_size for entry in archive.infolist())
        if unpacked > max(FREE_BYTES, LARGEST_FACTOR * path.stat().st_size):
            raise zipfile.BadZipFile(f"{unpacked} bytes when unpacked, of {path.stat().st_size}")
        damaged = archive.testzip()
    if damaged is not None:
        raise zipfile.BadZipFile(f"damaged: {damaged}")
