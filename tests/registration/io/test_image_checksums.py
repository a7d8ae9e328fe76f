"""PNG and TIFF files: every kind that is whole passes, and what is damaged or ends early is refused."""

from __future__ import annotations

import io
import struct
import zlib
from typing import Any

import numpy as np
import pytest
from PIL import Image
from stored_pngs import chunk

from registration.errors import InputError
from registration.io.image_checksums import require_whole_png, require_whole_tiff

VALUES = np.arange(7 * 11, dtype=np.uint8).reshape(7, 11) * 3


def stored(mode: str, kind: str = "png", **options: Any) -> bytes:
    stream = io.BytesIO()
    image = Image.fromarray(VALUES.astype(np.uint16) if mode == "I;16" else VALUES)
    (image if mode == "I;16" else image.convert(mode)).save(stream, kind, **options)
    return stream.getvalue()


def png(rows: bytes, bits: int = 8, interlaced: int = 0) -> bytes:
    head = struct.pack(">IIBBBBB", 11, 7, bits, 0, 0, 0, interlaced)
    parts = (b"IHDR", head), (b"IDAT", zlib.compress(rows)), (b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*part) for part in parts)


@pytest.mark.parametrize("mode", ["1", "L", "P", "LA", "RGB", "RGBA", "I;16"])
def test_every_kind_that_pillow_writes_is_whole(mode: str) -> None:
    require_whole_png(stored(mode), "a")


def test_rows_of_part_of_a_byte_and_interlaced_ones_are_counted() -> None:
    require_whole_png(png(bytes(7 * (1 + 6)), bits=4), "a")
    # Seven passes over 11 x 7 pixels: (columns, rows) of each, and a byte before each row.
    passes = [(2, 1), (1, 1), (3, 1), (3, 2), (6, 2), (5, 4), (11, 3)]
    require_whole_png(png(bytes(sum(rows * (1 + columns) for columns, rows in passes)), interlaced=1), "a")


@pytest.mark.parametrize("size", [0, 7 * 12 - 1, 7 * 12 + 1, 1 << 21])
def test_pixels_that_end_early_or_are_too_many_are_refused(size: int) -> None:
    with pytest.raises(InputError, match="a: expected 84 bytes of pixels to the last"):
        require_whole_png(png(bytes(size)), "a")


def test_a_changed_byte_anywhere_but_in_the_first_eight_is_refused() -> None:
    data = stored("L")
    for at in range(8, len(data) - 12):
        with pytest.raises(InputError, match=r"^a: expected "):
            require_whole_png(data[:at] + bytes([data[at] ^ 16]) + data[at + 1 :], "a")


def test_other_files_are_left_to_others() -> None:
    require_whole_png(stored("L", "bmp"), "a")
    require_whole_tiff(b"", {}, "a")


def test_strips_packed_by_deflate_are_unpacked_to_their_sum() -> None:
    data = stored("L", "tiff", compression="tiff_adobe_deflate")
    with Image.open(io.BytesIO(data)) as image:
        tags = dict(image.tag_v2)
    require_whole_tiff(data, tags, "a")
    begin, length = tags[273][0], tags[279][0]
    for at in range(begin + 2, begin + length):
        with pytest.raises(InputError, match="a: expected "):
            require_whole_tiff(data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :], tags, "a")
