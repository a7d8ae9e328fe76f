"""What lies under a path as one digest: the bytes of a file and of those that belong to it, or of a whole folder.

What no reader takes is left out: hidden files, what file managers leave behind, and whatever lies among images that is
neither an image nor a table, an array or a volume.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Collection, Iterator
from pathlib import Path

from experiments.errors import InputError
from experiments.running.digest_cache import DigestCache

ABSENT = "nothing"
_LEFT_BEHIND = frozenset({"thumbs.db", "ehthumbs.db", "desktop.ini", "__macosx", "__pycache__"})
_IMAGES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".dcm"})
# What is read among images; a DICOM file may have no suffix.
_AMONG_IMAGES = _IMAGES | {
    *("", ".csv", ".tsv", ".json", ".yaml", ".yml", ".xml", ".txt", ".xlsx", ".npy", ".npz"),
    *(".mha", ".mhd", ".raw", ".zraw", ".nrrd", ".nhdr", ".nii", ".gz"),
}
_HEADER_BYTES = 1 << 16
_DATA_FILE = re.compile(
    rb"^(?:ElementDataFile\s*=|data ?file:)[ \t]*([^\r\n]*)", re.MULTILINE | re.IGNORECASE
)


def content_digest(path: Path, leave_out: Collection[Path] = ()) -> str:
    """SHA-256 of what lies under ``path`` as it is read, ``ABSENT`` where there is nothing.

    ``leave_out`` are folders that are not looked into: where results go, which may lie inside what is read. Names
    count relative to ``path``, so that a folder that is moved keeps its digest. Raises InputError for what
    can't be read.

    Parameters
    ----------
    path : Path
        File or folder.
    leave_out : Collection[Path], optional
        Folders whose contents do not count.

    Returns
    -------
    str
        The digest in hexadecimal.
    """
    try:
        found = dict(_under(path, {_real(folder) for folder in leave_out}))
        if not found and not path.exists():
            return ABSENT
        with DigestCache() as cache:
            lines = [f"{name}\0{cache.digest(found[name])}\n" for name in sorted(found)]
    except OSError as failure:
        where = failure.filename or path
        raise InputError(
            f"{path}: expected files that can be read, found {where}: {failure.strerror or failure}"
        ) from failure
    return hashlib.sha256("".join(lines).encode("utf-8", "surrogateescape")).hexdigest()


def _under(path: Path, leave_out: Collection[str]) -> Iterator[tuple[str, Path]]:
    """The files that count, by their name from ``path`` on."""
    if path.is_file():
        yield "", path
        yield from _belonging_to(path, leave_out)
    elif path.is_dir():
        yield from _in_folder(path, "", leave_out, (_real(path),))


def _in_folder(
    folder: Path, prefix: str, leave_out: Collection[str], around: tuple[str, ...]
) -> Iterator[tuple[str, Path]]:
    """The files of a folder, recursively, links followed; ``around`` are the folders that it lies in."""
    with os.scandir(folder) as entries:
        shown = [entry for entry in entries if not _is_left_behind(entry.name)]
    plain = [entry for entry in shown if entry.is_file()]
    among_images = any(Path(entry.name).suffix.lower() in _IMAGES for entry in plain)
    for entry in plain:
        if not among_images or Path(entry.name).suffix.lower() in _AMONG_IMAGES:
            yield prefix + entry.name, Path(entry.path)
    for entry in shown:
        real = _real(Path(entry.path)) if entry.is_dir() else None
        # A link back to a folder around this one would never end.
        if real is not None and real not in leave_out and real not in around:
            yield from _in_folder(Path(entry.path), f"{prefix}{entry.name}/", leave_out, (*around, real))


def _belonging_to(path: Path, leave_out: Collection[str]) -> Iterator[tuple[str, Path]]:
    """What is read with a file: the pixels that a header names, the folder of a ROS 2 bag."""
    suffix = path.suffix.lower()
    if suffix in (".db3", ".mcap") and (path.parent / "metadata.yaml").is_file():
        yield from _in_folder(path.parent, "../", leave_out, (_real(path.parent),))
    elif suffix in (".mhd", ".mha", ".nhdr", ".nrrd"):
        with path.open("rb") as stream:
            named = _DATA_FILE.search(stream.read(_HEADER_BYTES))
        name = named.group(1).decode("utf-8", "replace").strip() if named else "LOCAL"
        if name.upper() == "LOCAL":
            return
        if (path.parent / name).is_file():
            yield f"../{name}", path.parent / name
        else:
            # A pattern or a list of files: whichever they are, they lie next to the header.
            neighbours = (file for file in path.parent.iterdir() if file.is_file() and file != path)
            yield from ((f"../{file.name}", file) for file in neighbours if not _is_left_behind(file.name))


def _is_left_behind(name: str) -> bool:
    return name.startswith((".", "~$")) or name.endswith("~") or name.lower() in _LEFT_BEHIND


def _real(path: Path) -> str:
    return os.path.realpath(path)
