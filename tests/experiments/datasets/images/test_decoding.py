"""What stands in a file, whatever a reading library makes of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from stored_pngs import GREY_ALPHA, write_png

from experiments.datasets.images.decoding import decode
from experiments.errors import InputError

LABELS = np.array([[0, 1, 2, 3], [3, 3, 1, 0], [2, 0, 0, 1]], dtype=np.uint8)


@pytest.mark.parametrize("bits", [1, 2, 4, 8, 16])
def test_grey_values_are_those_that_are_stored(tmp_path: Path, bits: int) -> None:
    stored = LABELS % 2 ** min(bits, 2)
    decoded = decode(write_png(tmp_path / "a.png", stored.astype(np.uint16), bits))
    np.testing.assert_array_equal(decoded.values, stored)
    assert (decoded.bits, decoded.largest, decoded.alpha, decoded.palette) == (bits, 2**bits - 1, None, None)


def test_a_bitmap_of_sixteen_grey_colours_is_not_read_byte_by_byte(tmp_path: Path) -> None:
    path = tmp_path / "a.bmp"
    width, height = 8, 4
    values = (np.arange(width * height) % 16).reshape(height, width).astype(np.uint8)
    palette = b"".join(bytes([level] * 3 + [0]) for level in range(16))
    rows = b"".join((row[0::2] << 4 | row[1::2]).tobytes() for row in values[::-1])
    offset = 14 + 40 + len(palette)
    head = b"BM" + (offset + len(rows)).to_bytes(4, "little") + b"\0" * 4 + offset.to_bytes(4, "little")
    sizes = [
        (40, 4),
        (width, 4),
        (height, 4),
        (1, 2),
        (4, 2),
        (0, 4),
        (len(rows), 4),
        (0, 4),
        (0, 4),
        (16, 4),
        (0, 4),
    ]
    path.write_bytes(
        head + b"".join(size.to_bytes(count, "little") for size, count in sizes) + palette + rows
    )
    decoded = decode(path)
    np.testing.assert_array_equal(decoded.values, values)
    assert decoded.bits == 8


def test_a_tiff_in_which_0_is_white_is_read_as_it_is_shown(tmp_path: Path) -> None:
    values = LABELS.astype(np.uint16) * 20000
    Image.fromarray(values).save(tmp_path / "a.tif", tiffinfo={262: 0})
    np.testing.assert_array_equal(decode(tmp_path / "a.tif").values, 65535 - values)


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("suffix", ["png", "jpg", "tif"])
def test_images_stand_as_they_are_shown(tmp_path: Path, suffix: str, orientation: int) -> None:
    shown = np.zeros((16, 24), np.uint8)
    shown[:8, :8] = 200
    turned = {
        1: shown,
        2: shown[:, ::-1],
        3: shown[::-1, ::-1],
        4: shown[::-1],
        5: shown.T,
        6: np.rot90(shown, 1),
        7: shown[::-1, ::-1].T,
        8: np.rot90(shown, -1),
    }[orientation]
    exif = Image.Exif()
    exif[274] = orientation
    path = tmp_path / f"a.{suffix}"
    Image.fromarray(np.ascontiguousarray(turned)).save(path, exif=exif)
    found = decode(path).values
    assert found.shape == shown.shape and np.abs(found.astype(int) - shown).max() <= 3


def test_transparency_is_kept_apart_and_says_nothing_where_it_is_the_same_everywhere(tmp_path: Path) -> None:
    alpha = np.where(LABELS > 1, 255, 0).astype(np.uint8)
    for values in (np.dstack([LABELS, alpha]), np.dstack([LABELS, LABELS, LABELS, alpha])):
        Image.fromarray(values).save(tmp_path / "a.png")
        decoded = decode(tmp_path / "a.png")
        np.testing.assert_array_equal(decoded.alpha, alpha)
        np.testing.assert_array_equal(
            decoded.values[..., 0] if decoded.values.ndim == 3 else decoded.values, LABELS
        )
    for level in (0, 128, 255):
        Image.fromarray(np.dstack([LABELS, np.full_like(alpha, level)])).save(tmp_path / "a.png")
        assert decode(tmp_path / "a.png").alpha is None
    # One grey value that the file declares transparent, in the numbers that it stores.
    marked = write_png(tmp_path / "m.png", LABELS, 2, tRNS=b"\0\x03")
    np.testing.assert_array_equal(decode(marked).alpha, np.where(LABELS == 3, 0, 255))


def test_a_palette_comes_with_its_colours_and_transparency(tmp_path: Path) -> None:
    image = Image.fromarray(LABELS, "P")
    image.putpalette([255, 255, 255, 0, 0, 0, 9, 8, 7, 1, 2, 3])
    image.save(tmp_path / "a.png", transparency=0)
    decoded = decode(tmp_path / "a.png")
    assert decoded.palette is not None
    np.testing.assert_array_equal(decoded.values, LABELS)
    assert decoded.palette[:4].tolist() == [
        [255, 255, 255, 0],
        [0, 0, 0, 255],
        [9, 8, 7, 255],
        [1, 2, 3, 255],
    ]


def test_refuses_sixteen_bits_of_grey_with_alpha(tmp_path: Path) -> None:
    path = write_png(tmp_path / "deep.png", np.zeros((3, 4, 2), np.uint16), 16, GREY_ALPHA)
    with pytest.raises(InputError, match=r"deep\.png: expected an image of 8 bits a channel, received 16"):
        decode(path)
