"""NRRD files: a text header of fields and keys, and the numbers that it promises, wherever they lie.

Format: http://teem.sourceforge.net/nrrd/format.html.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from registration.errors import InputError
from registration.input_files import beside, guarded
from registration.io.stored_data import Encoding, numbered_files, read_numbers, whole_number
from registration.io.truncation import read_bytes

TYPES = {
    "uchar": "u1", "unsigned char": "u1", "uint8": "u1", "uint8_t": "u1",
    "char": "i1", "signed char": "i1", "int8": "i1", "int8_t": "i1",
    "short": "i2", "short int": "i2", "signed short": "i2", "signed short int": "i2", "int16": "i2", "int16_t": "i2",
    "ushort": "u2", "unsigned short": "u2", "unsigned short int": "u2", "uint16": "u2", "uint16_t": "u2",
    "int": "i4", "signed int": "i4", "int32": "i4", "int32_t": "i4",
    "uint": "u4", "unsigned int": "u4", "uint32": "u4", "uint32_t": "u4",
    "longlong": "i8", "long long": "i8", "long long int": "i8", "signed long long": "i8",
    "signed long long int": "i8", "int64": "i8", "int64_t": "i8",
    "ulonglong": "u8", "unsigned long long": "u8", "unsigned long long int": "u8", "uint64": "u8", "uint64_t": "u8",
    "float": "f4", "double": "f8",
}  # fmt: skip
_PACKINGS = {"raw": "raw", "gz": "gzip", "gzip": "gzip", "bz2": "bzip2", "bzip2": "bzip2"}
_PACKINGS |= {"txt": "ascii", "text": "ascii", "ascii": "ascii", "hex": "hex"}
# Names of fields that may be written as one word.
_JOINED = ("byte skip", "line skip", "data file", "sample units", "old min", "old max")
# Where the numbers lie and how; the numbers themselves are given apart.
STORAGE = {"encoding", "endian", "byte skip", "line skip", "data file"}


@dataclass(frozen=True)
class NrrdFile:
    """Header and numbers of a NRRD file.

    Parameters
    ----------
    fields : dict of str to str
        Fields of the header in order, names in small letters.
    keys : dict of str to str
        Keys and values of the header in order.
    values : ndarray
        Numbers with the axes in NumPy's order: the fastest, which the header names first, is last.
    """

    fields: dict[str, str]
    keys: dict[str, str]
    values: np.ndarray

    @property
    def sizes(self) -> tuple[int, ...]:
        """The axes' lengths in the header's order."""
        return tuple(self.values.shape[::-1])

    def per_axis(self, field: str) -> list[str]:
        """Split a field that has a word for each axis.

        Parameters
        ----------
        field : str
            Name of the field.

        Returns
        -------
        list of str
            Its words, empty where the field is not there.
        """
        return self.fields.get(field, "").split()


@guarded("an NRRD file")
def read_nrrd_file(path: Path) -> NrrdFile:
    """Read header and numbers of a NRRD file.

    Parameters
    ----------
    path : Path
        File ending in ``.nrrd`` or ``.nhdr``.

    Returns
    -------
    NrrdFile
        Header and numbers.

    Raises
    ------
    InputError
        If the file is another or holds less than it promises.
    """
    content = read_bytes(path)
    if not content.startswith(b"NRRD"):
        raise InputError(f"{path}: expected an NRRD file, found one that does not begin with NRRD")
    # Pixels may hold anything, line ends too: only the first empty line counts.
    ends = [(content.find(mark), mark) for mark in (b"\n\n", b"\r\n\r\n") if mark in content]
    end, mark = min(ends, default=(len(content), b""))
    fields, keys, listed = _header(content[:end].decode("latin-1"))
    try:
        sizes = tuple(int(size) for size in fields["sizes"].split())
    except (KeyError, ValueError) as failure:
        raise InputError(
            f"{path}: expected whole numbers for sizes, found {fields.get('sizes')}"
        ) from failure
    if not sizes or min(sizes) < 0:
        raise InputError(f"{path}: expected sizes of axes, found {fields['sizes']!r}")
    kind, packing = TYPES.get(fields.get("type", "").lower()), _PACKINGS.get(_encoding(fields))
    if kind is None or packing is None:
        raise InputError(
            f"{path}: expected a number type and encoding raw, gzip, bzip2, ascii or hex, "
            f"found type {fields.get('type')}, encoding {_encoding(fields)}"
        )
    encoding = _storage(fields, packing, path)
    files = _data_files(fields.get("data file", ""), listed, path)
    count = math.prod(sizes)
    if not files:
        values = encoding.decode(content[end + len(mark) :], kind, count, path)
    else:
        values = read_numbers(files, encoding, kind, count, path)
    return NrrdFile(fields, keys, values.reshape(sizes[::-1]))


def nrrd_header(fields: dict[str, str], keys: dict[str, str], encoding: str) -> bytes:
    """Make a header for the same numbers, stored in the same file with another encoding, little end first.

    Parameters
    ----------
    fields : dict of str to str
        Fields of the header.
    keys : dict of str to str
        Keys and values of the header.
    encoding : str
        Name of the encoding.

    Returns
    -------
    bytes
        Header with the blank line that ends it.
    """
    lines = ["NRRD0005", *(f"{name}: {value}" for name, value in fields.items() if name not in STORAGE)]
    lines += ["endian: little", f"encoding: {encoding}"]
    lines += [f"{_escaped(key)}:={_escaped(value)}" for key, value in keys.items()]
    return ("\n".join(lines) + "\n\n").encode("latin-1")


def _storage(fields: dict[str, str], packing: str, path: Path) -> Encoding:
    encoding = Encoding(
        packing,
        whole_number(fields.get("line skip", "0"), "line skip", path),
        whole_number(fields.get("byte skip", "0"), "byte skip", path),
        ">" if fields.get("endian", "little").lower() == "big" else "<",
    )
    if encoding.lines_skipped < 0 or encoding.bytes_skipped < (-1 if packing == "raw" else 0):
        raise InputError(
            f"{path}: expected a line skip of 0 or more and a byte skip of 0 or more (or -1 for raw data), found "
            f"{encoding.lines_skipped} and {encoding.bytes_skipped} for {packing} data"
        )
    return encoding


def _encoding(fields: dict[str, str]) -> str:
    return fields.get("encoding", "raw").lower()


def _header(text: str) -> tuple[dict[str, str], dict[str, str], list[str]]:
    """Fields, keys, and the names of files that stand after ``data file: LIST``."""
    fields: dict[str, str] = {}
    keys: dict[str, str] = {}
    lines = text.splitlines()[1:]
    for number, line in enumerate(lines):
        if line.startswith("#") or ":" not in line:
            continue
        name, _, value = line.partition(":")
        if value.startswith("="):
            keys[_unescaped(name.strip())] = _unescaped(value[1:].strip())
            continue
        name = name.strip().lower()
        name = next((known for known in _JOINED if known.replace(" ", "") == name), name)
        fields[name] = value.strip()
        if name == "data file" and value.split()[:1] == ["LIST"]:
            return fields, keys, [line.strip() for line in lines[number + 1 :] if line.strip()]
    return fields, keys, []


def _data_files(where: str, listed: list[str], path: Path) -> list[Path]:
    words = where.split()
    if words[:1] == ["LIST"]:
        return [beside(path, name) for name in listed]
    if words and "%" in words[0]:
        return numbered_files(words[0], words[1:], path)
    return [beside(path, where)] if where and where.upper() != "LOCAL" else []


def _escaped(text: str) -> str:
    return text.replace("\\", "\\\\").replace("\n", "\\n")


def _unescaped(text: str) -> str:
    # Twice the backslash first, so that an n after it stays a letter.
    return "\\".join(part.replace("\\n", "\n") for part in text.split("\\\\"))
