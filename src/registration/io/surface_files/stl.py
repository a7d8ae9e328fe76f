"""STL, text or binary: the text decides which, for binary files may begin with ``solid`` too."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from registration.errors import InputError
from registration.input_files import read_regular
from registration.io.surface_files.polygons import Polygons

_HEADER, _RECORD = 84, 50
_RECORDS = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_TEXT_HEAD = 1 << 16
_SOLID_LINE = re.compile(r"^\s*(?:end\s*)?solid\b.*$", re.IGNORECASE | re.MULTILINE)
_BOM = b"\xef\xbb\xbf"


def is_text(data: bytes) -> bool:
    """Tell whether an STL file is text: it begins with ``solid`` and holds no zero byte.

    ``solid`` may be in any case and come after blanks. The number of triangles and the attributes of a binary
    file are full of zero bytes.

    Parameters
    ----------
    data : bytes
        Content of the file.

    Returns
    -------
    bool
        Whether it is text.
    """
    head = data[:_TEXT_HEAD].removeprefix(_BOM)
    return head.lstrip()[:5].lower() == b"solid" and b"\0" not in head


def read_stl(path: Path) -> Polygons:
    """Read all solids of an STL file as one; equal corners become one vertex.

    Parameters
    ----------
    path : Path
        File ending in ``.stl``, text or binary.

    Returns
    -------
    Polygons
        Points and triangles.

    Raises
    ------
    InputError
        If the file is cut short or a line of text is none of the format's.
    """
    data = read_regular(path)
    counted = len(data) >= _HEADER and len(data) == _HEADER + _RECORD * int.from_bytes(data[80:84], "little")
    corners = _text(path, data) if is_text(data) and not counted else _binary(path, data)
    points, owner = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    count = len(corners)
    return Polygons(points, owner.reshape(-1).astype(np.int64), 3 * np.arange(count + 1, dtype=np.int64))


def _binary(path: Path, data: bytes) -> Float64[np.ndarray, "t 3 3"]:
    count = int.from_bytes(data[80:84], "little") if len(data) >= _HEADER else 0
    size = _HEADER + _RECORD * count
    if len(data) < max(size, _HEADER):
        raise InputError(
            f"{path}: expected an STL file of 84 + 50 bytes a triangle, received {len(data)} bytes "
            "(cut short, or of another kind)"
        )
    records = np.frombuffer(data, dtype=_RECORDS, count=count, offset=_HEADER)
    corners = records["corners"].astype(np.float64)
    _refuse_more_triangles(path, data[size:], corners)
    return corners


def _refuse_more_triangles(path: Path, rest: bytes, corners: Float64[np.ndarray, "t 3 3"]) -> None:
    """Bytes after the last triangle are some program's own, unless they are triangles that the count leaves out."""
    more = np.frombuffer(rest, dtype=_RECORDS, count=len(rest) // _RECORD)["corners"].astype(np.float64)
    if not len(more) or not np.any(more):
        return
    if len(corners):
        low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
        reach = np.ptp(corners.reshape(-1, 3), axis=0).max()
        within = (more >= low - reach).all() and (more <= high + reach).all()
    else:
        within = bool(np.isfinite(more).all())
    if within:
        raise InputError(
            f"{path}: expected an STL file of 84 + 50 bytes a triangle, received {len(more)} triangles more than the "
            f"{len(corners)} it counts"
        )


def _text(path: Path, data: bytes) -> Float64[np.ndarray, "t 3 3"]:
    text = data.removeprefix(_BOM).decode("utf-8", errors="replace")
    solids = [line.group().split()[0].lower() for line in _SOLID_LINE.finditer(text)]
    words = _SOLID_LINE.sub("", text).lower().split()
    at = [place for place, word in enumerate(words) if word == "vertex"]
    facets = words.count("endfacet")
    if not solids or not solids[-1].startswith("end") or len(at) != 3 * facets:
        raise InputError(f"{path}: expected endsolid at the end, received an STL file that was cut short")
    try:
        numbers = np.array([words[place + 1 : place + 4] for place in at], dtype=np.float64)
    except ValueError as refusal:
        raise InputError(f"{path}: expected three numbers a vertex, received {refusal}") from refusal
    return numbers.reshape(-1, 3, 3)
