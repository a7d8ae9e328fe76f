"""Whether a file in VTK's older format is whole: VTK itself fills what is missing with whatever lies in memory.

The format is a list of sections, each with the number and the type of its values (VTK File Formats, "Simple Legacy
Formats"): they are walked over, and none of the values is looked at.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from registration.errors import InputError
from registration.input_files import read_regular

KINDS = ("POLYDATA", "UNSTRUCTURED_GRID")
_MAGIC = b"# vtk datafile version"
_BYTES = {
    "char": 1, "signed_char": 1, "unsigned_char": 1, "short": 2, "unsigned_short": 2, "int": 4, "unsigned_int": 4,
    "long": 8, "unsigned_long": 8, "float": 4, "double": 8, "vtkidtype": 4, "vtktypeint64": 8, "vtktypeuint64": 8,
    "vtktypeint32": 4, "vtktypeuint32": 4,
}  # fmt: skip
_CELLS = ("VERTICES", "LINES", "POLYGONS", "TRIANGLE_STRIPS", "CELLS")
_PER_POINT = {"VECTORS": 3, "NORMALS": 3, "TENSORS": 9, "TENSORS6": 6, "GLOBAL_IDS": 1, "PEDIGREE_IDS": 1}
# Corners of the kinds of cells whose number is fixed, and the kinds that have any number of at least one.
_CORNERS = {
    1: 1, 3: 2, 5: 3, 8: 4, 9: 4, 10: 4, 11: 8, 12: 8, 13: 6, 14: 5, 15: 10, 16: 12, 21: 3, 22: 6, 23: 8, 24: 10,
    25: 20, 26: 15, 27: 13, 28: 9, 29: 27, 30: 6, 31: 12, 32: 18, 33: 24, 34: 7, 35: 4,
}  # fmt: skip
_ANY_CORNERS = (2, 4, 6, 7)
_BLANK_LINE = re.compile(rb"\n[ \t\r]*\n")
_WORD = re.compile(rb"\S+")


@dataclass
class _Walk:
    path: Path
    data: bytes
    at: int
    binary: bool
    five: bool
    # How many values each attribute has: those of POINT_DATA or CELL_DATA; -1 before either.
    tuples: int = -1
    # Corners of each cell of a grid, once they are known.
    corners: np.ndarray | None = None

    def line(self) -> list[str]:
        """The words of the next line that has any; none at the end."""
        while self.at < len(self.data):
            end = self.data.find(b"\n", self.at)
            end = len(self.data) if end < 0 else end
            words = self.data[self.at : end].decode("utf-8", errors="replace").split()
            self.at = end + 1
            if words:
                return words
        return []

    def skip(self, count: int, kind: str) -> None:
        """Go past values; InputError where the file ends before they do."""
        if count < 0 or kind.lower() not in (*_BYTES, "bit", "string"):
            raise ValueError(kind)
        if kind.lower() == "string":
            self.skip_texts(count)
            return
        if self.binary:
            self.at += -(-count // 8) if kind.lower() == "bit" else count * _BYTES[kind.lower()]
            if self.at > len(self.data):
                raise self.cut(count)
            return
        words = _WORD.finditer(self.data, self.at)
        for _ in range(count):
            found = next(words, None)
            if found is None:
                raise self.cut(count)
            self.at = found.end()

    def whole_numbers(self, count: int, kind: str) -> np.ndarray:
        """Values that :meth:`skip` goes past."""
        begin = self.at
        self.skip(count, kind)
        data, width = self.data[begin : self.at], _BYTES[kind.lower()]
        sign = "u" if "u" in kind.lower() else "i"
        if self.binary:
            return np.frombuffer(data, f">{sign}{width}", count)
        return np.array(data.split()[:count], dtype=np.int64)

    def skip_texts(self, count: int) -> None:
        """Go past texts: a line each, or in binary the length before each, whose first two bits are its own width."""
        for _ in range(count):
            if self.at >= len(self.data):
                raise self.cut(count)
            if not self.binary:
                self.line()
                continue
            width = {3: 1, 2: 2, 1: 4, 0: 8}[self.data[self.at] >> 6]
            head = int.from_bytes(self.data[self.at : self.at + width], "big")
            self.at += width + (head & ((1 << (8 * width - 2)) - 1))

    def cut(self, count: int) -> InputError:
        return InputError(f"{self.path}: expected {count} more values, received fewer: cut short")


def require_whole_legacy(path: Path) -> str:
    """Read the kind of data set in a file of VTK's older format, which must be whole.

    Parameters
    ----------
    path : Path
        File ending in ``.vtk``.

    Returns
    -------
    str
        Kind of data set.

    Raises
    ------
    InputError
        If it is no surface, no VTK file at all, or cut short.
    """
    data = read_regular(path)
    if not data.lower().startswith(_MAGIC):
        raise InputError(
            f"{path}: expected a VTK file that begins with # vtk DataFile Version, received another"
        )
    head = data.split(b"\n", 3)
    form = head[2].strip().upper() if len(head) == 4 else b""
    five = head[0].split()[-1] >= b"5"
    walk = _Walk(path, data, sum(len(line) + 1 for line in head[:3]), form == b"BINARY", five)
    words = walk.line()
    kind = words[1].upper() if form in (b"ASCII", b"BINARY") and len(words) == 2 else "none"
    if kind not in KINDS:
        raise InputError(f"{path}: expected a surface (POLYDATA or UNSTRUCTURED_GRID), received {kind}")
    try:
        while words := walk.line():
            _section(walk, words)
    except InputError:  # which is a ValueError as well
        raise
    except (IndexError, ValueError) as refusal:
        raise InputError(
            f"{path}: expected sections of VTK, received {' '.join(words)[:40]!r}: cut short"
        ) from refusal
    return kind


def _section(walk: _Walk, words: list[str]) -> None:
    name = words[0].upper()
    if name == "POINTS":
        walk.skip(3 * int(words[1]), words[2])
    elif name in _CELLS:
        _cells(walk, words)
    elif name == "CELL_TYPES":
        _require_types(walk, walk.whole_numbers(int(words[1]), "int"))
    elif name == "METADATA":
        _past_blank_line(walk)
    elif name in ("POINT_DATA", "CELL_DATA"):
        walk.tuples = int(words[1])
    elif name == "FIELD":
        for _ in range(int(words[2])):
            array = walk.line()
            # Arrays of a field may be followed by what is known of them.
            if array[:1] == ["METADATA"]:
                _past_blank_line(walk)
                array = walk.line()
            # VTK looks at the first value of an array that has none.
            if int(array[1]) < 1 or (int(array[2]) < 1 and array[3].lower() != "string"):
                raise InputError(
                    f"{walk.path}: expected arrays that hold values, found {array[0]!r} without any"
                )
            walk.skip(int(array[1]) * int(array[2]), array[3])
    elif walk.tuples >= 0:
        _attribute(walk, name, words)
    else:
        raise ValueError(name)


def _cells(walk: _Walk, words: list[str]) -> None:
    count, size = int(words[1]), int(words[2])
    if not walk.five:
        _require_lengths(walk, words[0].upper(), walk.whole_numbers(size, "int"), count)
        return
    for name, values in (("OFFSETS", count), ("CONNECTIVITY", size)):
        part = walk.line()
        if part[0].upper() != name:
            raise ValueError(part[0])
        if name == "OFFSETS":
            _require_ends(walk, words[0].upper(), walk.whole_numbers(values, part[1]), size)
        else:
            walk.skip(values, part[1])


def _require_ends(walk: _Walk, section: str, ends: np.ndarray, size: int) -> None:
    """From version 5 on the cells are one list, and where each ends is another, which VTK follows unseen."""
    if len(ends) and (ends[0] < 0 or np.any(ends[1:] < ends[:-1]) or ends[-1] > size):
        raise InputError(
            f"{walk.path}: expected cells that end within {size} numbers, received others: cut short or damaged"
        )
    _keep_corners(walk, section, np.diff(ends))


def _keep_corners(walk: _Walk, section: str, corners: np.ndarray) -> None:
    if section == "TRIANGLE_STRIPS" and np.any(corners == 0):
        raise InputError(f"{walk.path}: expected strips of triangles, received one of no corner")
    if section == "CELLS":
        walk.corners = corners


def _require_types(walk: _Walk, types: np.ndarray) -> None:
    """Cells of a grid have as many corners as their kind needs: VTK takes them from memory."""
    corners = np.empty(0) if walk.corners is None else walk.corners
    if len(types) != len(corners):
        raise InputError(
            f"{walk.path}: expected a type for each of {len(corners)} cells, received {len(types)}"
        )
    for kind in np.unique(types).tolist():
        own = corners[types == kind]
        if kind in _CORNERS and np.all(own == _CORNERS[kind]):
            continue
        if kind not in _ANY_CORNERS or own.min() < 1:
            raise InputError(
                f"{walk.path}: expected cells with the corners of their type, received type {kind} with "
                f"{int(own.min())} to {int(own.max())}"
            )


def _require_lengths(walk: _Walk, section: str, values: np.ndarray, count: int) -> None:
    """Each cell is its number of points and these: VTK goes from one to the next by numbers that it does not check."""
    size = len(values)
    at, corners = 0, []
    while at < size and values[at] >= 0:
        corners.append(int(values[at]))
        at += corners[-1] + 1
    if at != size or len(corners) != count:
        raise InputError(
            f"{walk.path}: expected {count} cells in {size} numbers, received others: cut short or damaged"
        )
    _keep_corners(walk, section, np.array(corners, dtype=np.int64))


def _attribute(walk: _Walk, name: str, words: list[str]) -> None:
    if name == "SCALARS":
        table = walk.line()
        if table[0].upper() != "LOOKUP_TABLE":
            raise ValueError(table[0])
        walk.skip(walk.tuples * int(words[3] if len(words) > 3 else 1), words[2])
    elif name in _PER_POINT:
        walk.skip(walk.tuples * _PER_POINT[name], words[2])
    elif name == "TEXTURE_COORDINATES":
        walk.skip(walk.tuples * int(words[2]), words[3])
    elif name == "COLOR_SCALARS":
        walk.skip(walk.tuples * int(words[2]), "unsigned_char" if walk.binary else "float")
    elif name == "LOOKUP_TABLE":
        walk.skip(4 * int(words[2]), "unsigned_char" if walk.binary else "float")
    else:
        raise ValueError(name)


def _past_blank_line(walk: _Walk) -> None:
    end = _BLANK_LINE.search(walk.data, walk.at)
    walk.at = len(walk.data) if end is None else end.end()
