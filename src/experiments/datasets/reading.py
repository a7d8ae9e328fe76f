"""Images and masks from files, as every data set on disk reads them, with refusals that name the file."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Bool, UInt8
from PIL import Image, UnidentifiedImageError

from experiments.datasets.dicom import SUFFIX as DICOM_SUFFIX
from experiments.datasets.dicom import read_dicom
from experiments.errors import InputError
from models.grey import echo_grey, to_grey

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", DICOM_SUFFIX)
# Modes whose numbers are grey values or labels as they stand; all others are colours in one form or another.
_PLAIN = ("L", "I", "I;16", "I;16B", "I;16L", "F", "RGB", "RGBA")


def require_root(dataset: str, root: str | Path, source: str, layout: str) -> Path:
    """The folder of a data set; InputError says where to get it and how to point to it if it is not there."""
    folder = Path(root).expanduser()
    if not folder.is_dir():
        raise InputError(
            f"dataset.root: expected the folder of data set {dataset} ({source}; layout {layout}), "
            f"found no folder {folder}; pass dataset.root=<folder>"
        )
    return folder


def image_files(folder: Path) -> dict[str, Path]:
    """The images of a folder by their name without suffix, in order of name."""
    if not folder.is_dir():
        raise InputError(f"{folder}: expected a folder of images, found none")
    files = sorted(path for path in folder.iterdir() if _is_image(path))
    named: dict[str, Path] = {}
    for path in files:
        if path.stem in named:
            raise InputError(
                f"{path}: expected one image of each name, found {named[path.stem].name} as well"
            )
        named[path.stem] = path
    if not named:
        raise InputError(f"{folder}: expected images ({', '.join(IMAGE_SUFFIXES)}), found none")
    return named


def paired(images: Mapping[str, Path], masks: Mapping[str, Path]) -> None:
    """Raise InputError naming the first image without a mask, or mask without an image."""
    for ours, other, what in ((images, masks, "a mask"), (masks, images, "an image")):
        alone = next((path for name, path in ours.items() if name not in other), None)
        if alone is not None:
            raise InputError(f"{alone}: expected {what} of the same name, found none")


def read_grey(path: Path) -> UInt8[np.ndarray, "h w"]:
    """The grey values of one frame's echoes: an image of 8 bits a channel, or a DICOM file of one frame.

    Colour becomes grey by ``models.grey.echo_grey``, as it does in the predictor. 16 bits a channel are refused (but in
    DICOM, which says how many of them count): what they are to be divided by, a picture doesn't tell.
    """
    if path.suffix.lower() == DICOM_SUFFIX:
        frames = read_dicom(path).images
        if len(frames) != 1:
            raise InputError(f"{path}: expected one frame, received a film of {len(frames)}")
        return np.asarray(frames[0])
    pixels = _pixels(path)
    if pixels.dtype != np.uint8:
        raise InputError(f"{path}: expected an image of 8 bits a channel, received {pixels.dtype}")
    return echo_grey(pixels)


def read_mask(
    path: Path, vessel: Collection[int], others: Collection[int], size: tuple[int, ...]
) -> Bool[np.ndarray, "h w"]:
    """Where a label image has one of the ``vessel`` labels; ``others`` are the further ones it may hold."""
    labels = _pixels(path, labels=True)
    if labels.ndim == 3:
        labels = to_grey(labels)
    if labels.shape != size:
        raise InputError(
            f"{path}: expected the mask to have its image's size {size[1]}x{size[0]}, "
            f"received {labels.shape[1]}x{labels.shape[0]}"
        )
    unknown = sorted(set(np.unique(labels).tolist()) - set(vessel) - set(others))
    if unknown:
        raise InputError(
            f"{path}: expected labels {', '.join(map(str, sorted({*vessel, *others})))}, "
            f"received {', '.join(map(str, unknown[:5]))}"
        )
    return np.isin(labels, list(vessel))


def require_vessel(folder: Path, masks: Collection[np.ndarray]) -> None:
    """Raise InputError if no mask of a data set shows any vessel."""
    if not any(mask.any() for mask in masks):
        raise InputError(f"{folder}: expected masks with a vessel, received {len(masks)} empty ones")


def _is_image(path: Path) -> bool:
    # What begins with a dot is a system's own, such as the ._name.png that macOS leaves beside name.png.
    return path.suffix.lower() in IMAGE_SUFFIXES and not path.name.startswith(".") and path.is_file()


def _pixels(path: Path, labels: bool = False) -> np.ndarray:
    if not path.is_file():
        raise InputError(f"{path}: expected an image, found no file")
    try:
        with Image.open(path) as image:
            _require_one_whole(path, image)
            mode = _mode(image.mode, labels)
            return np.asarray(image if mode == image.mode else image.convert(mode))
    except InputError:
        raise
    except (UnidentifiedImageError, Image.DecompressionBombError, OSError, ValueError, SyntaxError) as error:
        raise InputError(f"{path}: expected an image, received a file that can't be read as one") from error


def _require_one_whole(path: Path, image: Image.Image) -> None:
    frames = getattr(image, "n_frames", 1)
    if frames != 1:
        raise InputError(f"{path}: expected one image, received a stack of {frames}")
    # PIL hands out the upper bytes of 16-bit colours without a word.
    if image.mode in ("RGB", "RGBA") and any(";16" in str(tile[3]) for tile in getattr(image, "tile", ())):
        raise InputError(f"{path}: expected an image of 8 bits a channel, received 16")


def _mode(mode: str, labels: bool) -> str:
    """What to read an image of some mode as."""
    if mode in ("1", "LA", "La"):
        return "L"
    # A palette is how a label image is shown, and its indices are the labels; in a picture the colours count.
    if mode in _PLAIN or (mode == "P" and labels):
        return mode
    return "RGB"
