"""PLY, text or binary of either byte order, with polygons of any number of corners."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from registration.errors import InputError
from registration.input_files import read_regular
from registration.io.surface_files.polygons import Polygons, joined

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": "<"}
_CORNERS = ("vertex_indices", "vertex_index")
_LONGEST_HEADER = 1 << 16
_BOM = b"\xef\xbb\xbf"


@dataclass(frozen=True)
class _Property:
    name: str
    kind: str
    # The type of a list's length; empty for a single value.
    length: str = ""


@dataclass(frozen=True)
class _Element:
    name: str
    count: int
    properties: list[_Property]


def read_ply(path: Path) -> Polygons:
    """Read vertices and faces of a PLY file.

    Parameters
    ----------
    path : Path
        File ending in ``.ply``, text or binary.

    Returns
    -------
    Polygons
        Points and polygons.

    Raises
    ------
    InputError
        If the header is broken or the file shorter than it promises.
    """
    data = read_regular(path).removeprefix(_BOM)
    place = data.find(b"end_header", 0, _LONGEST_HEADER)
    if place < 0 or not data.startswith(b"ply"):
        raise InputError(f"{path}: expected a header that ends in end_header, received none")
    body = data[place + len(b"end_header") :].removeprefix(b"\r").removeprefix(b"\n")
    head = data[:place].decode("ascii", errors="replace").splitlines()
    try:
        form, elements = _parsed(head)
        body_of = _text_body if form == "ascii" else _binary_body
        found = body_of(path, elements, body, _ORDERS[form])
        points = np.column_stack([found["vertex"][axis] for axis in "xyz"]).astype(np.float64)
    except InputError:
        raise
    except (KeyError, IndexError, ValueError) as refusal:
        raise InputError(
            f"{path}: expected a header that can be read, received {refusal!r} in it"
        ) from refusal
    if "tristrips" in found:
        raise InputError(f"{path}: expected faces, received triangle strips")
    faces = found.get("face", {})
    corners = next((faces[name] for name in _CORNERS if name in faces), None)
    if corners is None:
        return Polygons(points)
    return Polygons(points, *corners)


def _parsed(head: list[str]) -> tuple[str, list[_Element]]:
    form, elements = "", []
    for words in (line.split() for line in head):
        if words[:1] == ["format"]:
            form = words[1]
        elif words[:1] == ["element"]:
            count = int(words[2])
            if count < 0:
                raise ValueError(f"{count} of element {words[1]}")
            elements.append(_Element(words[1], count, []))
        elif words[:2] == ["property", "list"]:
            elements[-1].properties.append(_Property(words[4], _TYPES[words[3]], _TYPES[words[2]]))
        elif words[:1] == ["property"]:
            elements[-1].properties.append(_Property(words[2], _TYPES[words[1]]))
    return form, elements


def _text_body(path: Path, elements: list[_Element], body: bytes, _order: str) -> dict[str, dict]:
    words = body.split()
    # A face has three corners at least: exact for triangles, a lower bound for polygons.
    minimum = sum(
        element.count * (4 if one.length and one.name in _CORNERS else 1)
        for element in elements
        for one in element.properties
    )
    if len(words) < minimum:
        raise InputError(
            f"{path}: expected {minimum} numbers after the header, received {len(words)}: cut short"
        )
    values = np.array(words, dtype=np.float64)
    found, at = {}, 0
    for element in elements:
        columns: dict[str, list] = {one.name: [] for one in element.properties}
        if not any(one.length for one in element.properties):
            width = len(element.properties)
            table = values[at : at + element.count * width].reshape(element.count, width)
            found[element.name] = dict(zip(columns, table.T, strict=True))
            at += element.count * width
            continue
        for _ in range(element.count):
            for one in element.properties:
                size = int(values[at]) if one.length else 1
                at += bool(one.length)
                if at + size > len(values):
                    raise InputError(
                        f"{path}: expected more numbers for its faces, received {len(values)}: cut short"
                    )
                columns[one.name].append(values[at : at + size])
                at += size
        found[element.name] = _columns(element, columns)
    return found


def _binary_body(path: Path, elements: list[_Element], body: bytes, order: str) -> dict[str, dict]:
    minimum = sum(
        element.count
        * (
            np.dtype(one.length or one.kind).itemsize
            + 3 * (one.name in _CORNERS) * np.dtype(one.kind).itemsize
        )
        for element in elements
        for one in element.properties
    )
    if len(body) < minimum:
        raise InputError(
            f"{path}: expected {minimum} bytes after the header, received {len(body)}: cut short"
        )
    found, at = {}, 0
    for element in elements:
        table = _uniform(element, body, at, order)
        if table is not None:
            found[element.name] = {
                one.name: _same_size(table[one.name]) if one.length else table[one.name]
                for one in element.properties
            }
            at += table.nbytes
        else:
            found[element.name], at = _one_by_one(path, element, body, at, order)
    return found


def _uniform(element: _Element, body: bytes, at: int, order: str) -> np.ndarray | None:
    """All rows at once, where every list of the element is as long as the first row's; else None."""
    fields: list[tuple] = []
    place = at
    for one in element.properties:
        if one.length and element.count:
            width = np.dtype(one.length).itemsize
            size = (
                int(np.frombuffer(body, order + one.length, 1, place)[0]) if len(body) >= place + width else 0
            )
            fields += [(f"{one.name} length", order + one.length), (one.name, order + one.kind, (size,))]
            place += width + size * np.dtype(one.kind).itemsize
        else:
            fields.append((one.name, order + one.kind))
            place += np.dtype(one.kind).itemsize
    kind = np.dtype(fields)
    if len(body) < at + element.count * kind.itemsize:
        return None
    table = np.frombuffer(body, kind, element.count, at)
    lists = [name for name, *_ in fields if name.endswith(" length")]
    return table if all((table[name] == table[name][:1]).all() for name in lists) else None


def _one_by_one(path: Path, element: _Element, body: bytes, at: int, order: str) -> tuple[dict, int]:
    columns: dict[str, list] = {one.name: [] for one in element.properties}
    for _ in range(element.count):
        for one in element.properties:
            size = 1
            if one.length:
                size = int(_values(path, body, order + one.length, 1, at)[0])
                at += np.dtype(one.length).itemsize
            columns[one.name].append(_values(path, body, order + one.kind, size, at))
            at += size * np.dtype(one.kind).itemsize
    return _columns(element, columns), at


def _values(path: Path, body: bytes, kind: str, size: int, at: int) -> np.ndarray:
    if size < 0 or at + size * np.dtype(kind).itemsize > len(body):
        raise InputError(f"{path}: expected more bytes for its faces, received {len(body)}: cut short")
    return np.frombuffer(body, kind, size, at)


def _columns(element: _Element, columns: dict[str, list]) -> dict:
    """Single values as arrays, lists as all their entries and where each begins."""
    return {
        one.name: joined([row.astype(np.int64).tolist() for row in columns[one.name]])
        if one.length and one.name in _CORNERS
        else np.array([row[0] if len(row) else np.nan for row in columns[one.name]], dtype=np.float64)
        for one in element.properties
    }


def _same_size(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    corners = rows.astype(np.int64).reshape(-1)
    return corners, len(corners) // max(len(rows), 1) * np.arange(len(rows) + 1, dtype=np.int64)
