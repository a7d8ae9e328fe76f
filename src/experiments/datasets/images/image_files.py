"""Images and masks from files, as every data set on disk reads them, with refusals that name the file."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Shaped, UInt8

from experiments.datasets.images.decoding import OPAQUE, Decoded, decode
from experiments.datasets.images.dicom import SUFFIX as DICOM_SUFFIX
from experiments.datasets.images.dicom import is_dicom, read_dicom
from experiments.datasets.images.label_values import label_values
from experiments.errors import InputError
from experiments.unicode_names import same_name
from models.preprocessing.grey import echo_grey

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", DICOM_SUFFIX)
# Of transparency that changes a picture by less, nobody sees anything.
_SEEN_ALPHA = 3
_SYSTEM_FILES = ("thumbs.db", "desktop.ini", "dicomdir")


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
    """The images of a folder by their name without suffix, in order of name.

    DICOM files are found by their content too, as scanners write them without suffix: their name is then the whole one.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: expected a folder of images, found none")
    named: dict[str, Path] = {}
    for path in sorted(folder.iterdir()):
        if not _is_image(path):
            continue
        name = same_name(path.stem if path.suffix.lower() in IMAGE_SUFFIXES else path.name)
        if name in named:
            raise InputError(f"{path}: expected one image of each name, found {named[name].name} as well")
        named[name] = path
    if not named:
        raise InputError(f"{folder}: expected images ({', '.join(IMAGE_SUFFIXES)}), found none")
    return named


def other_files(folder: Path) -> tuple[Path, ...]:
    """The files of a folder that are no images, without those that systems leave there."""
    return tuple(
        path
        for path in sorted(folder.iterdir())
        if path.is_file()
        and not _is_image(path)
        and not path.name.startswith(".")
        and path.name.casefold() not in _SYSTEM_FILES
    )


def read_grey(path: Path) -> UInt8[np.ndarray, "h w"]:
    """The grey values of one frame's echoes: an image of 8 bits a channel, or a DICOM file of one frame.

    Colour becomes grey by ``models.preprocessing.grey.echo_grey``, as it does in the predictor; 1, 2 and 4
    bits are scaled to 8. Of
    16 bits, values that are 8 bits in a wider form (v * 257 or v * 256) are taken; others are refused (but in DICOM,
    which says how many of them count): what they are to be divided by, a picture doesn't tell.
    """
    if is_dicom(path):
        frames = read_dicom(path).images
        if len(frames) != 1:
            raise InputError(f"{path}: expected one frame, received a film of {len(frames)}")
        return np.asarray(frames[0])
    decoded = decode(path)
    if decoded.palette is not None:
        colours = decoded.palette[decoded.values]
        decoded = Decoded(colours[..., :3], alpha=colours[..., 3])
    picture = echo_grey(_eight_bits(path, decoded))
    if decoded.alpha is not None:
        hidden = np.rint(picture * (decoded.alpha / OPAQUE)).astype(np.int16)
        if int((picture - hidden).max()) >= _SEEN_ALPHA:
            raise InputError(
                f"{path}: expected an opaque image, received one with pixels that its transparency hides; "
                "save it without an alpha channel"
            )
    return picture


def read_mask(
    path: Path, vessel: Collection[int], others: Collection[int], size: tuple[int, ...] | None = None
) -> Bool[np.ndarray, "h w"]:
    """Where a label image has one of the ``vessel`` labels; ``others`` are the further ones it may hold.

    What its colours, bits and transparency mean as labels is said in ``label_values``. InputError for another ``size``
    than given, for labels in neither list, and for a mask that holds 1 and 255 where either stands for the vessel.
    """
    labels = read_labels(path, vessel, others)
    if size is not None and labels.shape != tuple(size):
        raise InputError(
            f"{path}: expected the mask to have its image's size {size[1]}x{size[0]}, "
            f"received {labels.shape[1]}x{labels.shape[0]}"
        )
    found = set(np.unique(labels).tolist())
    unknown = sorted(found - set(vessel) - set(others))
    if unknown:
        raise InputError(
            f"{path}: expected labels {', '.join(map(str, sorted({*vessel, *others})))}, "
            f"received {', '.join(map(str, unknown[:5]))}"
        )
    if {1, 255} <= found & set(vessel):
        raise InputError(
            f"{path}: expected a mask of 0 and 1 or of 0 and 255, received one with both 1 and 255, "
            "of which 255 may be what is not labelled; name the vessel's label alone"
        )
    return np.isin(labels, list(vessel))


def read_labels(
    path: Path, vessel: Collection[int] = (1, 255), others: Collection[int] = (0,)
) -> Shaped[np.ndarray, "h w"]:
    """The labels of a mask file as its colours, bits and transparency mean them (see ``label_values``)."""
    return label_values(path, decode(path), vessel, others)


def read_mask_values(path: Path) -> Shaped[np.ndarray, "h w"]:
    """A mask or probability map: bool where the file is black and white by its form, else its grey values.

    Grey values are uint8, those of more bits uint16 of which 65535 is white; the caller says what they mean, for that
    takes the masks of all frames. Colours that are not grey must be a mask by the rules of ``label_values``.
    """
    decoded = decode(path)
    values = decoded.values
    if decoded.palette is not None:
        used = decoded.palette[np.unique(values)]
        if bool((used[:, 3] == OPAQUE).all()) and bool((used[:, :3] == used[:, :1]).all()):
            return np.asarray(decoded.palette[values, 0])
    elif decoded.alpha is None and decoded.bits > 1:
        if values.ndim == 3 and bool((values == values[..., :1]).all()):
            return np.ascontiguousarray(values[..., 0])
        if values.ndim == 2:
            return _grey_of_any_depth(path, decoded)
    return read_mask(path, (1, 255), (0,))


def _grey_of_any_depth(path: Path, decoded: Decoded) -> np.ndarray:
    values, largest = decoded.values, decoded.largest
    if decoded.bits == 8:
        return values
    if not decoded.bits <= 16 or values.dtype.kind != "u":
        raise InputError(f"{path}: expected a mask of at most 16 bits, received {values.dtype}")
    # Labels of few bits, and 0 and 1 of many, stay as they are stored.
    if bool(((values == 0) | (values == largest)).all()):
        return values > 0
    if decoded.bits < 8 or values.max() <= 1:
        return values.astype(np.uint8)
    return np.rint(values * (65535.0 / largest)).astype(np.uint16)


def require_vessel(folder: Path, masks: Collection[np.ndarray]) -> None:
    """Raise InputError if no mask of a data set shows any vessel."""
    if not any(mask.any() for mask in masks):
        raise InputError(f"{folder}: expected masks with a vessel, received {len(masks)} empty ones")


def _is_image(path: Path) -> bool:
    # What begins with a dot is a system's own, such as the ._name.png that macOS leaves beside name.png.
    if path.name.startswith(".") or not path.is_file():
        return False
    return path.suffix.lower() in IMAGE_SUFFIXES or is_dicom(path)


def _eight_bits(path: Path, decoded: Decoded) -> np.ndarray:
    """The values of a picture scaled so that 255 is white."""
    values = decoded.values
    if decoded.bits < 8:
        return (values * (255 // decoded.largest)).astype(np.uint8)
    if decoded.bits == 16 and values.dtype == np.uint16:
        high, low = values >> 8, values & 0xFF
        if bool((low == high).all()) or (high.any() and not low.any()):
            return high.astype(np.uint8)
    if values.dtype != np.uint8:
        raise InputError(f"{path}: expected an image of 8 bits a channel, received {values.dtype}")
    return values
