"""Numbers as image files store them: skipped, packed, spread over several files, and checked to be all there.

What libraries leave unchecked is checked here: the sum at the end of a packed stream, and that it ends at all.
"""

from __future__ import annotations

import bz2
import re
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from registration.errors import InputError
from registration.input_files import beside, require_regular, require_unpacked_size

_NUMBERED = re.compile(r"%0?\d{0,2}[diu]")
_MAX_FILES = 100_000


@dataclass(frozen=True)
class Encoding:
    """How bytes in a file become numbers.

    Parameters
    ----------
    packing : {'raw', 'gzip', 'zlib', 'bzip2', 'ascii', 'hex'}, optional
        How the numbers are packed.
    lines_skipped : int, optional
        Lines before the numbers, left out before unpacking.
    bytes_skipped : int, optional
        Bytes before the numbers, left out after unpacking; -1 for all bytes but those of the numbers.
    order : {'<', '>'}, optional
        Little or big end first.
    """

    packing: str = "raw"
    lines_skipped: int = 0
    bytes_skipped: int = 0
    order: str = "<"

    def decode(self, data: bytes, kind: str, count: int, path: Path | str) -> np.ndarray:
        """Convert bytes to numbers.

        Parameters
        ----------
        data : bytes
            Content of the file.
        kind : str
            NumPy's type of the numbers, without byte order.
        count : int
            How many numbers there are.
        path : Path or str
            Name of the file, for messages.

        Returns
        -------
        ndarray, shape (count,)
            Numbers.

        Raises
        ------
        InputError
            If the bytes cannot be unpacked or hold fewer numbers.
        """
        data = self._without_lines(data, path)
        size = count * np.dtype(kind).itemsize
        if self.packing == "ascii":
            _require_words(len(data), count, path)
            return _from_text(data[max(self.bytes_skipped, 0) :], kind, count, path)
        data = _unpack(data, self.packing, max(self.bytes_skipped, 0) + size, path)
        first = len(data) - size if self.bytes_skipped == -1 else self.bytes_skipped
        if first < 0 or len(data) - first < size:
            raise _cut_short(path, size, max(0, len(data) - max(first, 0)))
        numbers = np.frombuffer(data, np.dtype(self.order + kind), count=count, offset=first)
        return numbers.astype(kind, copy=False)

    def _without_lines(self, data: bytes, path: Path | str) -> bytes:
        begin = 0
        for _ in range(self.lines_skipped):
            begin = data.find(b"\n", begin) + 1
            if not begin:
                raise InputError(f"{path}: expected {self.lines_skipped} lines to skip, found fewer")
        return data[begin:]


def read_numbers(
    files: Sequence[Path], encoding: Encoding, kind: str, count: int, path: Path, begin: int = 0
) -> np.ndarray:
    """Read the numbers in files one after the other, equally many in each.

    Parameters
    ----------
    files : sequence of Path
        Files in order.
    encoding : Encoding
        How their bytes become numbers.
    kind : str
        NumPy's type of the numbers, without byte order.
    count : int
        How many numbers all files hold together.
    path : Path
        Name of the header, for messages.
    begin : int, optional
        Byte at which the numbers begin.

    Returns
    -------
    ndarray, shape (count,)
        Numbers.

    Raises
    ------
    InputError
        If a file is not there or holds too little.
    """
    if not files or count % len(files):
        raise InputError(f"{path}: expected {count} numbers in equal parts, found {len(files)} data files")
    if len(set(files)) != len(files):
        raise InputError(
            f"{path}: expected each data file once, found {len(files)} names of {len(set(files))}"
        )
    share = count // len(files)
    parts = []
    for file in files:
        name = path if file == path else f"{path}: {file.name}"
        data = _part(file, encoding, share * np.dtype(kind).itemsize, begin, path, name)
        parts.append(encoding.decode(data, kind, share, name))
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def numbered_files(pattern: str, words: Sequence[str], path: Path) -> list[Path]:
    """List the files that a pattern with a number names, such as ``slice%03d.raw``.

    Parameters
    ----------
    pattern : str
        Pattern of C with one number.
    words : sequence of str
        First, last and step of the number.
    path : Path
        Header; the files lie in its folder.

    Returns
    -------
    list of Path
        Files in order.

    Raises
    ------
    InputError
        If the pattern or the numbers are none.
    """
    try:
        first, last, step = (int(word) for word in (*words[:2], *(words[2:3] or ["1"])))
        numbers = range(first, last + (1 if step > 0 else -1), step)
    except ValueError as failure:
        raise InputError(
            f"{path}: expected first, last and step of the numbers in {pattern}, found {' '.join(words)!r}"
        ) from failure
    if len(_NUMBERED.findall(pattern)) != 1 or pattern.count("%") != 1 or not 0 < len(numbers) <= _MAX_FILES:
        raise InputError(
            f"{path}: expected a pattern with one number (slice%03d.raw 1 20 1), found {pattern}"
        )
    return [beside(path, pattern % number) for number in numbers]


def whole_number(text: str, name: str, path: Path) -> int:
    """Convert the whole number in a field of a header.

    Parameters
    ----------
    text : str
        Content of the field.
    name : str
        Name of the field, for messages.
    path : Path
        Name of the file, for messages.

    Returns
    -------
    int
        Number.

    Raises
    ------
    InputError
        If the text is no whole number.
    """
    try:
        return int(text)
    except ValueError as failure:
        raise InputError(f"{path}: expected a whole number in {name}, found {text!r}") from failure


def _part(file: Path, encoding: Encoding, size: int, begin: int, path: Path, name: Path | str) -> bytes:
    """The bytes of one file from ``begin`` on; those that hold no pixels are not read where they can be told."""
    try:
        there = require_regular(file).stat().st_size - begin
    except InputError as failure:
        found = str(failure).partition(", received ")[2]
        raise InputError(f"{path}: expected its voxels in {file}, received {found}") from failure
    plain = encoding.packing == "raw" and not encoding.lines_skipped
    needed = size + max(encoding.bytes_skipped, 0)
    if plain and there < needed:
        raise _cut_short(name, size, max(0, there - max(encoding.bytes_skipped, 0)))
    try:
        with file.open("rb") as stream:
            stream.seek(begin)
            return stream.read(needed if plain and encoding.bytes_skipped >= 0 else -1)
    except OSError as failure:
        raise InputError(
            f"{path}: expected its voxels in {file}, received {(failure.strerror or str(failure)).lower()}"
        ) from failure


def _cut_short(path: Path | str, size: int, found: int) -> InputError:
    return InputError(f"{path}: expected {size} bytes of pixels, found {found} (the file was cut short)")


def _unpack(data: bytes, packing: str, size: int, path: Path | str) -> bytes:
    if packing == "hex":
        try:
            return bytes.fromhex(data.decode("ascii"))
        except ValueError as failure:
            raise InputError(f"{path}: expected hexadecimal digits as pixels, found others") from failure
    if packing == "raw":
        return data
    require_unpacked_size(size, len(data), path)
    if packing == "bzip2":
        return _streams(data, bz2.BZ2Decompressor, packing, size, path)
    # 32 recognises either header.
    return _streams(data, lambda: zlib.decompressobj(zlib.MAX_WBITS | 32), packing, size, path)


def _streams(data: bytes, start: Callable[[], Any], packing: str, size: int, path: Path | str) -> bytes:
    """Unpack one stream, or several gzip or bzip2 streams in a row, to their end, where their sum is checked."""
    kind = {"gzip": "gzipped", "zlib": "zlib-compressed", "bzip2": "bzip2-compressed"}[packing]
    magic = {"gzip": b"\x1f\x8b", "bzip2": b"BZh", "zlib": b""}[packing]
    whole = bytearray()
    while not whole or (magic and data.startswith(magic)):
        stream = start()
        try:
            # One byte more than promised shows that there are more, and is all that they may take.
            whole += stream.decompress(data, size + 1 - len(whole))
        except (zlib.error, OSError, EOFError) as failure:
            raise InputError(f"{path}: expected {kind} pixels, found broken data ({failure})") from failure
        if len(whole) > size:
            raise InputError(
                f"{path}: expected {size} bytes of {kind} pixels, as its header says, found more"
            )
        if not stream.eof:
            raise InputError(
                f"{path}: expected {kind} pixels with their end, found a stream that breaks off (cut short)"
            )
        data = stream.unused_data
    return bytes(whole)


def _require_words(size: int, count: int, path: Path | str) -> None:
    """Numbers as text take a digit and a blank each: what cannot hold them is not even split."""
    if 2 * count - 1 > size:
        raise InputError(
            f"{path}: expected {count} pixels as text, found {size} bytes (the file was cut short)"
        )


def _from_text(data: bytes, kind: str, count: int, path: Path | str) -> np.ndarray:
    words = data.replace(b",", b" ").split()
    if len(words) < count:
        raise InputError(
            f"{path}: expected {count} pixels as text, found {len(words)} (the file was cut short)"
        )
    try:
        return np.array([word.decode("ascii") for word in words[:count]]).astype(kind)
    except (ValueError, OverflowError) as failure:
        raise InputError(f"{path}: expected pixels of type {kind} as text, found others") from failure
