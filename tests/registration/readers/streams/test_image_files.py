"""Pictures decoded by meaning: the same scene written in every way gives the same grey values."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from registration.errors import InputError
from registration.readers.streams.image_files import decode_image, grey_stack, list_images

SCENE = np.array([[0, 51, 102], [153, 204, 255]], dtype=np.uint8)


def encoded(image: Image.Image, kind: str = "png", **settings: object) -> bytes:
    stream = io.BytesIO()
    image.save(stream, kind, **settings)
    return stream.getvalue()


def grey(*contents: bytes) -> np.ndarray:
    return grey_stack([decode_image(content, "a") for content in contents], "a")


def palette_picture() -> Image.Image:
    """Index 0 is white: indices run against the grey values."""
    image = Image.fromarray((5 - SCENE // 51).astype(np.uint8), "L")
    image = image.copy()
    shown = Image.new("P", image.size)
    shown.putdata(list(np.asarray(image).ravel()))
    shown.putpalette([value for step in range(6) for value in [255 - 51 * step] * 3])
    return shown


def rotated(kind: str) -> bytes:
    """Stored upside down and turned left to right, with the tag that says so."""
    exif = Image.Exif()
    exif[0x0112] = 3
    return encoded(Image.fromarray(SCENE[::-1, ::-1].copy()), kind, exif=exif)


@pytest.mark.parametrize(
    "content",
    [
        encoded(Image.fromarray(SCENE)),
        encoded(Image.fromarray(SCENE), "bmp"),
        encoded(Image.fromarray(SCENE), "tiff"),
        encoded(Image.fromarray(np.dstack([SCENE] * 3))),
        encoded(Image.fromarray(np.dstack([*[SCENE] * 3, np.full_like(SCENE, 255)]))),
        encoded(Image.fromarray(np.dstack([SCENE, np.full_like(SCENE, 255)]), "LA")),
        encoded(Image.fromarray(SCENE.astype(np.uint16) * 257)),
        encoded(palette_picture()),
        rotated("png"),
        rotated("tiff"),
    ],
    ids=["png", "bmp", "tiff", "rgb", "rgba", "la", "16 bits", "palette", "exif png", "exif tiff"],
)
def test_one_scene_in_many_encodings(content: bytes) -> None:
    np.testing.assert_array_equal(grey(content), [SCENE])


def test_jpeg_with_an_orientation() -> None:
    ramp = np.repeat(np.arange(0, 256, 16, dtype=np.uint8)[None], 16, axis=0)
    exif = Image.Exif()
    exif[0x0112] = 6
    stored = encoded(Image.fromarray(ramp), "jpeg", quality=100, exif=exif)
    assert np.abs(grey(stored)[0].astype(int) - np.rot90(ramp, -1)).max() <= 2


def test_transparency_is_laid_on_black() -> None:
    alpha = np.where(SCENE > 100, 255, 0).astype(np.uint8)
    shown = encoded(Image.fromarray(np.dstack([np.full_like(SCENE, 200), alpha]), "LA"))
    np.testing.assert_array_equal(grey(shown)[0], np.where(SCENE > 100, 200, 0))
    for unused in (0, 17):
        left = Image.fromarray(np.dstack([SCENE, np.full_like(SCENE, unused)]), "LA")
        np.testing.assert_array_equal(grey(encoded(left)), [SCENE])


def test_16_bits_of_a_tiff_in_which_0_is_white() -> None:
    wide = SCENE.astype(np.uint16) * 257
    normal = encoded(Image.fromarray(wide), "tiff")
    inverted = encoded(Image.fromarray(65535 - wide), "tiff", tiffinfo={262: 0})
    assert Image.open(io.BytesIO(inverted)).tag_v2[262] == 0
    np.testing.assert_array_equal(grey(normal, inverted), [SCENE, SCENE])


def test_16_bits_are_scaled_together_and_only_from_full_scale() -> None:
    dark = np.full((2, 3), 2570, np.uint16)
    bright = SCENE.astype(np.uint16) * 257
    found = grey(encoded(Image.fromarray(dark)), encoded(Image.fromarray(bright)))
    assert found[0].tolist() == [[10] * 3] * 2
    np.testing.assert_array_equal(found[1], SCENE)
    np.testing.assert_array_equal(grey(encoded(Image.fromarray(SCENE.astype(np.uint16)))), [SCENE])
    with pytest.raises(
        InputError, match=r"a: .*16 bits that use their full scale \(65535\), found none above 4080"
    ):
        grey(encoded(Image.fromarray(SCENE.astype(np.uint16) * 16)))
    with pytest.raises(InputError, match="a: expected one bit depth"):
        grey(encoded(Image.fromarray(bright)), encoded(Image.fromarray(SCENE)))


def test_stacks_and_what_is_no_picture_are_refused() -> None:
    pages = [Image.fromarray(SCENE), Image.fromarray(SCENE)]
    with pytest.raises(InputError, match="a: expected one picture, found a stack of 2"):
        grey(encoded(pages[0], "tiff", save_all=True, append_images=pages[1:]))
    with pytest.raises(InputError, match="a: expected a readable PNG image"):
        grey(b"nothing of the kind")


def test_colour_of_16_bits_is_refused() -> None:
    """Pillow would hand out its upper bytes."""
    import struct
    import zlib

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    rows = zlib.compress(b"\0" + struct.pack(">3H", 65535, 1000, 0))
    head = struct.pack(">IIBBBBB", 1, 1, 16, 2, 0, 0, 0)
    content = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")
    with pytest.raises(InputError, match="a: expected 8 bits a channel, found 16"):
        grey(content)


def test_pictures_are_listed_in_natural_order_and_hidden_ones_are_not(tmp_path: Path) -> None:
    for name in ("f10.png", "f2.PNG", "f1.Jpg", "f3.tif", "f4.bmp", "._f1.png", ".DS_Store", "Thumbs.db"):
        (tmp_path / name).write_bytes(b"")
    found = [path.name for path in list_images(tmp_path)]
    assert found == ["f1.Jpg", "f2.PNG", "f3.tif", "f4.bmp", "f10.png"]


def test_ambiguous_names_and_other_kinds_of_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "frame.npy").write_bytes(b"")
    with pytest.raises(InputError, match=r"expected pictures \(\.png, .*found frame\.npy"):
        list_images(tmp_path)
    for name in ("frame_001.png", "frame_1.png"):
        (tmp_path / name).write_bytes(b"")
    with pytest.raises(InputError, match="found frame_001 and frame_1"):
        list_images(tmp_path)
    (tmp_path / "frame_001.png").rename(tmp_path / "frame_1.jpg")
    with pytest.raises(InputError, match=r"one picture of each name, found frame_1\.jpg and frame_1\.png"):
        list_images(tmp_path)
