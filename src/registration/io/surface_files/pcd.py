"""PCD of the Point Cloud Library: text, binary or compressed, of numbers of any size."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from registration.errors import InputError
from registration.input_files import read_regular
from registration.io.surface_files.polygons import Polygons

_KINDS = {"F": "f", "I": "i", "U": "u"}
_LONGEST_HEADER = 1 << 16


def read_pcd(path: Path) -> Polygons:
    """Read the fields x, y and z of a PCD file.

    Parameters
    ----------
    path : Path
        File ending in ``.pcd``.

    Returns
    -------
    Polygons
        Points without polygons.

    Raises
    ------
    InputError
        If the header is broken or the file shorter than it promises.
    """
    data = read_regular(path)
    place = data.find(b"\nDATA", 0, _LONGEST_HEADER)
    if place < 0:
        raise InputError(f"{path}: expected a header that ends in DATA, received none")
    kind, _, body = data[place + len(b"\nDATA") :].partition(b"\n")
    head = data[:place].decode("utf-8-sig", errors="replace").splitlines()
    try:
        entries = {line.split()[0].upper(): line.split()[1:] for line in head if line.strip()}
        row, axes, points = _layout(entries)
        read = {b"ascii": _text, b"binary": _binary, b"binary_compressed": _compressed}[kind.strip().lower()]
        table = read(path, body, row, points)
        return Polygons(np.column_stack([table[axis] for axis in axes]).astype(np.float64).reshape(-1, 3))
    except InputError:
        raise
    except (KeyError, IndexError, ValueError, TypeError) as refusal:
        raise InputError(
            f"{path}: expected a header that can be read, received {refusal!r} in it"
        ) from refusal


def _layout(entries: dict[str, list[str]]) -> tuple[np.dtype, list[str], int]:
    """The numbers of one point, which of them are x, y and z, and how many points there are."""
    names = [name.lower() for name in entries["FIELDS"]]
    kinds = [f"<{_KINDS[kind]}{size}" for kind, size in zip(entries["TYPE"], entries["SIZE"], strict=True)]
    counts = [int(count) for count in entries.get("COUNT", ["1"] * len(names))]
    fields = list(zip(names, kinds, counts, strict=True))
    # Fields may share a name ("_" is padding), so they go by their place.
    row = np.dtype([(f"{place}", kind, (count,)) for place, (_, kind, count) in enumerate(fields)])
    axes = [f"{names.index(axis)}" for axis in "xyz"]
    if "POINTS" in entries:
        return row, axes, int(entries["POINTS"][0])
    return row, axes, int(entries["WIDTH"][0]) * int(entries.get("HEIGHT", ["1"])[0])


def _text(path: Path, body: bytes, row: np.dtype, points: int) -> dict[str, np.ndarray]:
    words = body.split()
    widths = [row[name].shape[0] for name in row.names or ()]
    if len(words) < points * sum(widths):
        raise InputError(
            f"{path}: expected {points * sum(widths)} numbers after the header, received {len(words)}: cut short"
        )
    table = np.array(words[: points * sum(widths)], dtype=np.float64).reshape(points, sum(widths))
    begins = np.concatenate([[0], np.cumsum(widths)])
    return {name: table[:, begins[at]] for at, name in enumerate(row.names or ())}


def _binary(path: Path, body: bytes, row: np.dtype, points: int) -> dict[str, np.ndarray]:
    if len(body) < points * row.itemsize:
        raise InputError(
            f"{path}: expected {points * row.itemsize} bytes after the header, received {len(body)}: cut short"
        )
    table = np.frombuffer(body, row, points)
    return {name: table[name][:, 0] for name in row.names or ()}


def _compressed(path: Path, body: bytes, row: np.dtype, points: int) -> dict[str, np.ndarray]:
    """All values of the first field, then of the second, packed together by LZF."""
    packed, size = (int(value) for value in np.frombuffer(body, "<u4", 2)) if len(body) >= 8 else (0, 0)
    if len(body) < 8 + packed or size < points * row.itemsize:
        raise InputError(
            f"{path}: expected {8 + packed} bytes after the header with {points * row.itemsize} in them, "
            f"received {len(body)} with {size}: cut short"
        )
    loose = _unpacked(path, body[8 : 8 + packed], size)
    found, at = {}, 0
    for name in row.names or ():
        kind = row[name]
        block = np.frombuffer(loose, kind.base, points * kind.shape[0], at)
        found[name] = block.reshape(points, -1)[:, 0]
        at += block.nbytes
    return found


def _unpacked(path: Path, packed: bytes, size: int) -> bytes:
    """LibLZF's stream: runs of bytes as they are, and copies of what came before."""
    out, at = bytearray(), 0
    try:
        while at < len(packed):
            control = packed[at]
            at += 1
            if control < 32:
                out += packed[at : at + control + 1]
                at += control + 1
                continue
            length = control >> 5
            if length == 7:
                length += packed[at]
                at += 1
            begin = len(out) - ((control & 31) << 8) - packed[at] - 1
            at += 1
            if begin < 0:
                raise IndexError(begin)
            copied = bytes(out[begin : begin + length + 2])
            # A copy may reach into itself: it then repeats.
            out += (copied * ((length + 2) // len(copied) + 1))[: length + 2]
    except IndexError as failure:
        raise InputError(f"{path}: expected compressed points, received bytes that are none") from failure
    if len(out) != size:
        raise InputError(f"{path}: expected {size} bytes when unpacked, received {len(out)}: cut short")
    return bytes(out)
