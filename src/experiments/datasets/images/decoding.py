"""Image files as numbers whose meaning is known: grey values, colours or palette entries, and what is transparent.

Pillow alone does not tell them apart: it scales 1, 2 and 4 bits to 255, hands out palette indices as if they were grey
values, leaves the EXIF orientation to the caller, and drops the lower bytes of 16-bit colours.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Shaped, UInt8
from PIL import Image, ImageOps

from experiments.errors import InputError, reading
from registration.input_files import read_regular
from registration.io.image_checksums import LARGEST_PIXELS, require_whole_png, require_whole_tiff

OPAQUE = 255
_BITS_OF_MODE = {"1": 1, "L": 8, "LA": 8, "I;16": 16, "I;16B": 16, "I;16L": 16, "I": 32, "F": 32}


@dataclass(frozen=True)
class Decoded:
    """The pixels of one image in the orientation in which it is shown.

    Parameters
    ----------
    values : ndarray, shape (h, w) or (h, w, 3)
        Grey values as they are stored, not scaled to 8 bits; RGB colours of 8 bits; or palette indices.
    palette : ndarray of uint8, shape (n, 4), or None
        RGBA colours that ``values`` are the indices of.
    alpha : ndarray of uint8, shape (h, w), or None
        Opacity; None where it is constant and so says nothing, and for a palette, which has its own.
    bits : int
        Bits of a grey value.
    lossy : bool
        Whether the compression changes values.
    """

    values: Shaped[np.ndarray, "h w *rgb"]
    palette: UInt8[np.ndarray, "n 4"] | None = None
    alpha: UInt8[np.ndarray, "h w"] | None = None
    bits: int = 8
    lossy: bool = False

    @property
    def largest(self) -> int:
        """The value that stands for white."""
        return int(2**self.bits - 1)


def decode(path: Path) -> Decoded:
    """Read an image file.

    Parameters
    ----------
    path : Path
        A file in any format that Pillow reads.

    Returns
    -------
    Decoded
        Its pixels.

    Raises
    ------
    InputError
        If the file is missing, damaged, a stack of several images, or has colours of 16 bits.
    """
    if not path.is_file():
        raise InputError(f"{path}: expected an image, found no file")
    with reading(path, "an image"):
        data = read_regular(path)
        require_whole_png(data, path)
        # From a stream: of a path, Pillow maps the pixels of a plain TIFF before it turns them, with sides swapped.
        with Image.open(io.BytesIO(data)) as image:
            _require_one_whole(path, image)
            require_whole_tiff(data, getattr(image, "tag_v2", {}), path)
            return _decoded(path, image)


def _require_one_whole(path: Path, image: Image.Image) -> None:
    if image.width * image.height > LARGEST_PIXELS:
        raise InputError(
            f"{path}: expected at most {LARGEST_PIXELS} pixels, received {image.width}x{image.height}"
        )
    frames = getattr(image, "n_frames", 1)
    if frames != 1:
        raise InputError(f"{path}: expected one image, received a stack of {frames}")
    # Pillow hands out the upper bytes of 16-bit colours without a word.
    if image.mode in ("RGB", "RGBA") and ";16" in _raw_mode(image):
        raise InputError(f"{path}: expected an image of 8 bits a channel, received 16")


def _decoded(path: Path, image: Image.Image) -> Decoded:
    bits, scale = _stored_bits(path, image)
    lossy = image.format == "JPEG" or image.info.get("compression") == "jpeg"
    inverted = image.mode == "I;16" and getattr(image, "tag_v2", {}).get(262) == 0
    image.load()
    ImageOps.exif_transpose(image, in_place=True)
    clear = image.info.get("transparency")
    if image.mode == "P":
        return Decoded(np.asarray(image), palette=_palette(image, clear), lossy=lossy)
    if image.mode not in _BITS_OF_MODE:
        return _coloured(image, clear, lossy)
    values = np.asarray(image)
    alpha = None
    if image.mode == "LA":
        values, alpha = values[..., 0], values[..., 1]
    if scale > 1 or bits == 1:
        values = values.astype(np.uint8) // np.uint8(scale)
    if inverted:  # a 16-bit TIFF in which 0 is white: Pillow turns those of fewer bits round, not these
        values = 65535 - values
    if clear is not None and alpha is None and isinstance(clear, int):
        alpha = np.where(values == (clear if bits > 1 else int(clear > 0)), 0, OPAQUE).astype(np.uint8)
    return Decoded(values, alpha=_if_it_varies(alpha), bits=bits, lossy=lossy)


def _coloured(image: Image.Image, clear: Any, lossy: bool) -> Decoded:
    has_alpha = image.mode in ("RGBA", "RGBa", "La", "PA") or clear is not None
    pixels = np.asarray(image.convert("RGBA" if has_alpha else "RGB"))
    alpha = pixels[..., 3] if has_alpha else None
    return Decoded(np.ascontiguousarray(pixels[..., :3]), alpha=_if_it_varies(alpha), lossy=lossy)


def _if_it_varies(alpha: np.ndarray | None) -> np.ndarray | None:
    return None if alpha is None or bool((alpha == alpha[0, 0]).all()) else alpha


def _palette(image: Image.Image, clear: Any) -> np.ndarray:
    """All 256 colours (RGBA); entries that the file does not have are black."""
    stored = np.array(image.getpalette("RGB") or [], dtype=np.uint8).reshape(-1, 3)
    palette = np.zeros((256, 4), dtype=np.uint8)
    palette[: len(stored), :3] = stored
    palette[:, 3] = OPAQUE
    if isinstance(clear, bytes):
        palette[: len(clear), 3] = np.frombuffer(clear, dtype=np.uint8)
    elif isinstance(clear, int):
        palette[clear, 3] = 0
    return palette


def _stored_bits(path: Path, image: Image.Image) -> tuple[int, int]:
    """Bits of a grey value in the file (8 for colours), and what Pillow multiplies it by."""
    raw = _raw_mode(image)
    if image.format == "BMP" and image.mode == "L" and _bmp_bits(path) == 4:
        # Grey values 0 to 15 in a palette: Pillow drops the palette and takes half bytes for bytes.
        image.tile = [tile._replace(args=("L;4", *tile.args[1:])) for tile in image.tile]  # type: ignore[attr-defined]
        return 8, 17
    if image.mode == "L" and raw.startswith(("L;2", "L;4")):
        bits = int(raw[2])
        return bits, 255 // (2**bits - 1)
    return (12 if raw == "I;12" else _BITS_OF_MODE.get(image.mode, 8)), 1


def _bmp_bits(path: Path) -> int:
    with path.open("rb") as stream:
        return int.from_bytes(stream.read(30)[28:30], "little")


def _raw_mode(image: Image.Image) -> str:
    """How the file stores pixels, in Pillow's words; empty where it doesn't say."""
    for tile in getattr(image, "tile", ()):
        raw = tile[3][0] if isinstance(tile[3], tuple) and tile[3] else tile[3]
        return str(raw or "")
    return ""
