"""Pictures from files or messages by what their pixels mean: bit depth, palette, transparency, orientation."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from PIL import Image, ImageOps

from registration.errors import InputError
from registration.input_files import read_regular, refusing
from registration.io.image_checksums import LARGEST_PIXELS, require_whole_png, require_whole_tiff
from registration.natural_order import natural_order
from registration.readers.streams.checks import as_grey

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
_WIDE = ("I", "I;16", "I;16B", "I;16L", "I;16N")
# 16 bits a pixel hold 65535 = 255 * 257 at full scale (PNG specification, "Sample depth scaling").
_WIDE_STEP = 257
_TOP_BIT = 1 << 15
_MAX_WIDE = np.uint16(65535)
_PHOTOMETRIC = 262


def list_images(folder: Path) -> list[Path]:
    """List the pictures in a folder in the natural order of their names, without hidden and other files.

    Parameters
    ----------
    folder : Path
        Folder.

    Returns
    -------
    list of Path
        Pictures in order.

    Raises
    ------
    InputError
        If the order is ambiguous, or the folder holds files, none of them a picture.
    """
    shown = [path for path in folder.glob("*") if path.is_file() and not path.name.startswith(".")]
    named: dict[str, Path] = {}
    for path in sorted(path for path in shown if path.suffix.lower() in SUFFIXES):
        if path.stem in named:
            raise InputError(
                f"{folder}: expected one picture of each name, found {named[path.stem].name} and {path.name}"
            )
        named[path.stem] = path
    if shown and not named:
        raise InputError(
            f"{folder}: expected pictures ({', '.join(SUFFIXES)}), found {min(path.name for path in shown)}"
        )
    return [named[name] for name in natural_order(named, str(folder))]


def decode_image(source: Path | bytes, name: str) -> np.ndarray:
    """Decode one picture.

    The camera's orientation (EXIF) is applied, palettes are looked up, transparency that varies is laid on
    black.

    Parameters
    ----------
    source : Path or bytes
        File or its content.
    name : str
        Name of the picture, for messages.

    Returns
    -------
    ndarray, shape (h, w) or (h, w, 3)
        Pixels of 8 bits; grey of 16 bits stays as wide as it is.

    Raises
    ------
    InputError
        If it is no picture, several in one file, or colour of 16 bits.
    """
    with refusing(name, "a readable PNG image (or JPEG, BMP, TIFF)"):
        data = source if isinstance(source, bytes) else read_regular(source)
        require_whole_png(data, name)
        with Image.open(io.BytesIO(data)) as image:
            _require_plain(image, name)
            require_whole_tiff(data, getattr(image, "tag_v2", {}), name)
            # Pillow turns TIFF files in which 0 is white round, but for those of 16 bits.
            white_is_0 = getattr(image, "tag_v2", {}).get(_PHOTOMETRIC) == 0
            return _pixels(ImageOps.exif_transpose(image), white_is_0)


def grey_stack(pictures: list[np.ndarray], name: str) -> UInt8[np.ndarray, "n height width"]:
    """Convert pictures of one size to 8-bit grey.

    Grey of 16 bits is brought to 8 where the recording uses the topmost bit, and taken as it is where no
    value is above 255.

    Parameters
    ----------
    pictures : list of ndarray
        Pictures.
    name : str
        Their name, for messages.

    Returns
    -------
    ndarray, shape (n, height, width)
        Frames in grey of 8 bits.

    Raises
    ------
    InputError
        If sizes differ, or between those two cases nothing states what full scale is.
    """
    largest = max((int(pixels.max(initial=0)) for pixels in pictures if pixels.dtype != np.uint8), default=0)
    wide = largest >= _TOP_BIT and all(p.dtype in (np.uint8, np.uint16) for p in pictures)
    if largest > np.iinfo(np.uint8).max and not wide:
        raise InputError(
            f"{name}: expected pixels of 8 bits, or of 16 bits that use their full scale (65535), "
            f"found none above {largest}"
        )
    if wide and any(pixels.dtype == np.uint8 for pixels in pictures):
        raise InputError(f"{name}: expected one bit depth, found pictures of 8 and of 16 bits")
    narrow = [np.rint(pixels / _WIDE_STEP).astype(np.uint8) if wide else pixels for pixels in pictures]
    return np.stack([as_grey(pixels[None], name)[0] for pixels in narrow])


def _require_plain(image: Image.Image, name: str) -> None:
    if image.width * image.height > LARGEST_PIXELS:
        raise InputError(
            f"{name}: expected at most {LARGEST_PIXELS} pixels, found {image.width}x{image.height}"
        )
    frames = getattr(image, "n_frames", 1)
    if frames != 1:
        raise InputError(f"{name}: expected one picture, found a stack of {frames}")
    # Pillow hands out the upper bytes of colour of 16 bits without a word.
    if image.mode not in _WIDE and any(";16" in str(tile[3]) for tile in getattr(image, "tile", ())):
        raise InputError(f"{name}: expected 8 bits a channel, found 16")
    if image.mode == "F":
        raise InputError(f"{name}: expected whole numbers, found floating-point pixels")


def _pixels(image: Image.Image, white_is_0: bool) -> np.ndarray:
    if image.mode in _WIDE:
        wide = np.asarray(image)
        if image.mode == "I":
            return wide
        return _MAX_WIDE - wide.astype(np.uint16) if white_is_0 else wide.astype(np.uint16)
    if image.has_transparency_data:
        pixels = np.asarray(image.convert("RGBA"))
        colour, alpha = pixels[..., :3], pixels[..., 3:]
        # Transparency that is the same everywhere is a channel that a program left unused.
        if (alpha == alpha[:1, :1]).all():
            return colour
        return np.rint(colour * (alpha / np.iinfo(np.uint8).max)).astype(np.uint8)
    return np.asarray(image.convert("L" if image.mode in ("1", "L") else "RGB"))
