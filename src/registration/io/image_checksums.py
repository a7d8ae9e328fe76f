"""Pictures whose packed pixels are all there and undamaged, which Pillow does not look at.

Pillow stops unpacking once the last row is full: it sees neither the sums of a PNG file's chunks nor the one at the
end of its pixels, and fills with black what is missing of pixels that end early. The same holds for TIFF strips packed
by deflate. Formats: PNG (ISO/IEC 15948, "Chunk layout", "Interlacing"), TIFF 6.0 with Adobe's supplement.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from registration.errors import InputError
from registration.input_files import require_unpacked_size

# No frame of an ultrasound machine comes near; as colours with transparency they take 200 MB.
LARGEST_PIXELS = 50_000_000
_PNG = b"\x89PNG\r\n\x1a\n"
_SAMPLES = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
# First row and column, and the steps, of the seven passes of an interlaced picture.
_PASSES = ((0, 0, 8, 8), (0, 4, 8, 8), (4, 0, 8, 4), (0, 2, 4, 4), (2, 0, 4, 2), (0, 1, 2, 2), (1, 0, 2, 1))
_DEFLATE = (8, 32946)
_COMPRESSION, _STRIPS, _STRIP_BYTES, _TILES, _TILE_BYTES = 259, 273, 279, 324, 325


def require_whole_png(data: bytes, name: Path | str) -> None:
    """Raise InputError for a PNG file with a wrong sum, or whose pixels are not as many as its header says.

    Parameters
    ----------
    data : bytes
        Content of a file; one that is no PNG file is left to others.
    name : Path or str
        Its name, for messages.

    Raises
    ------
    InputError
        If the file is damaged or cut short.
    """
    if not data.startswith(_PNG):
        return
    size, packed = None, bytearray()
    for kind, content in _chunks(data, name):
        if kind == b"IHDR" and len(content) == 13:
            size = _unpacked_size(content, name)
        elif kind == b"IDAT":
            packed += content
    if size is None or not packed:
        raise InputError(f"{name}: expected a readable PNG image, found no header or no pixels")
    require_unpacked_size(size, len(packed), name)
    _require_sum(bytes(packed), size, name)


def require_whole_tiff(data: bytes, tags: Mapping[int, Any], name: Path | str) -> None:
    """Raise InputError for a TIFF file one of whose strips or tiles, packed by deflate, has a wrong sum.

    Parameters
    ----------
    data : bytes
        Content of the file.
    tags : mapping of int to Any
        Its tags by their number.
    name : Path or str
        Its name, for messages.

    Raises
    ------
    InputError
        If the file is damaged or cut short.
    """
    if tags.get(_COMPRESSION) not in _DEFLATE:
        return
    for places, sizes in ((_STRIPS, _STRIP_BYTES), (_TILES, _TILE_BYTES)):
        for begin, length in zip(_numbers(tags.get(places)), _numbers(tags.get(sizes)), strict=False):
            _require_sum(data[begin : begin + length], None, name)


def _chunks(data: bytes, name: Path | str) -> Iterator[tuple[bytes, bytes]]:
    at = len(_PNG)
    while at + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        end = at + 12 + length
        if end > len(data):
            break
        content = data[at + 8 : end - 4]
        if zlib.crc32(kind + content) != struct.unpack_from(">I", data, end - 4)[0]:
            raise InputError(
                f"{name}: expected a readable PNG image, found a damaged one (checksum of {kind!r})"
            )
        yield kind, content
        if kind == b"IEND":
            return
        at = end
    raise InputError(f"{name}: expected a readable PNG image, found one that was cut short")


def _unpacked_size(header: bytes, name: Path | str) -> int:
    """Bytes of all rows, each with the byte that names its filter."""
    width, height, bits, kind, _, _, interlaced = struct.unpack(">IIBBBBB", header)
    if kind not in _SAMPLES or bits not in (1, 2, 4, 8, 16) or not width or not height:
        raise InputError(
            f"{name}: expected a readable PNG image, found kind {kind} of {bits} bits, {width}x{height} pixels"
        )
    sizes = [(height, width)]
    if interlaced:
        sizes = [
            (-(-(height - row) // down), -(-(width - col) // right)) for row, col, down, right in _PASSES
        ]
    return sum(
        rows * (1 + -(-columns * bits * _SAMPLES[kind] // 8))
        for rows, columns in sizes
        if rows > 0 and columns > 0
    )


def _require_sum(packed: bytes, size: int | None, name: Path | str) -> None:
    """Unpack to the end in blocks that are not kept; without a size any is right."""
    stream, found = zlib.decompressobj(), 0
    try:
        while not stream.eof:
            block = stream.decompress(packed, 1 << 20)
            found += len(block)
            packed = stream.unconsumed_tail
            if (size is not None and found > size) or (not block and not packed):
                break
    except zlib.error as failure:
        raise InputError(f"{name}: expected a readable image, found damaged pixels ({failure})") from failure
    if not stream.eof or (size is not None and found != size):
        expected = "all of its pixels" if size is None else f"{size} bytes of pixels"
        raise InputError(
            f"{name}: expected {expected} to the last, found {found} bytes (cut short or damaged)"
        )


def _numbers(value: Any) -> Sequence[int]:
    return value if isinstance(value, tuple) else () if value is None else (value,)
