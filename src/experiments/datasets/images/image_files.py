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
    """Check that the folder of a data set is there.

    Parameters
    ----------
    dataset : str
        Name of the data set.
    root : str or Path
        The folder that ``dataset.root`` names.
    source : str
        Where the data can be obtained, for the message.
    layout : str
        What the folder must hold, for the message.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    InputError
        If there is none.
    """
    folder = Path(root).expanduser()
    if not folder.is_dir():
        raise InputError(
            f"dataset.root: expected the folder of data set {dataset} ({source}; layout {layout}), "
            f"found no folder {folder}; pass dataset.root=<folder>"
        )
    return folder


def image_files(folder: Path) -> dict[str, Path]:
    """List the images of a folder by name.

    Parameters
    ----------
    folder : Path
        A folder of images.

    Returns
    -------
    dict of str to Path
        Files by their name without suffix, in order of name. DICOM files are recognised by their content too,
        as scanners write them without a suffix: their name is then the whole one.

    Raises
    ------
    InputError
        If the folder is missing, has no image, or two of one name.
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
    """List the files of a folder that are no images.

    Parameters
    ----------
    folder : Path
        A folder of images.

    Returns
    -------
    tuple of Path
        Files in order of name, without those that operating systems leave there.
    """
    return tuple(
        path
        for path in sorted(folder.iterdir())
        if path.is_file()
        and not _is_image(path)
        and not path.name.startswith(".")
        and path.name.casefold() not in _SYSTEM_FILES
    )


def read_grey(path: Path) -> UInt8[np.ndarray, "h w"]:
    """Read the grey values of the echoes of one frame.

    Parameters
    ----------
    path : Path
        An image of 8 bits a channel, or a DICOM file of one frame.

    Returns
    -------
    ndarray of uint8, shape (h, w)
        Grey values.

    Raises
    ------
    InputError
        If the image has transparent pixels, more than 8 bits whose scale is not known, or several frames.

    Notes
    -----
    Colour becomes grey by ``models.preprocessing.grey.echo_grey``, as it does in the predictor; 1, 2 and 4
    bits are scaled to 8. Of 16 bits, values that are 8 bits in a wider form (v * 257 or v * 256) are taken.
    Others are refused, except in DICOM, which says how many bits count: an image does not tell what to divide
    by.
    """
    if is_dicom(path):
        frames = read_dicom(path).images
        if len(frames) != 1:
            raise InputError(f"{path}: expected one frame, received {len(frames)}")
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
    """Read where a label image has one of the vessel's labels.

    Parameters
    ----------
    path : Path
        A label image; what its colours, bits and transparency mean is defined in ``label_values``.
    vessel : collection of int
        Labels of the vessel.
    others : collection of int
        Further labels that the image may hold.
    size : tuple of int or None
        Height and width in px that the mask must have; None: any.

    Returns
    -------
    ndarray of bool, shape (h, w)
        The mask.

    Raises
    ------
    InputError
        If the size differs, a label is in neither list, or 1 and 255 both occur where either stands for the
        vessel.
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
    """Read the labels of a mask file as its colours, bits and transparency mean them (see ``label_values``).

    Parameters
    ----------
    path : Path
        A label image.
    vessel : collection of int
        Labels of the vessel.
    others : collection of int
        Further labels that the image may hold.

    Returns
    -------
    ndarray, shape (h, w)
        Labels, which may include some that are in neither list.
    """
    return label_values(path, decode(path), vessel, others)


def read_mask_values(path: Path) -> Shaped[np.ndarray, "h w"]:
    """Read a mask or probability map as it is stored.

    Parameters
    ----------
    path : Path
        An image in grey values, or a mask in colours by the rules of ``label_values``.

    Returns
    -------
    ndarray, shape (h, w)
        bool where the file is black and white by its format, else grey values: uint8, or uint16 of which
        65535 is white for more bits. What they mean is for the caller to decide, from the masks of all
        frames.

    Raises
    ------
    InputError
        If the file is no such image.
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
    """Check that some mask of a data set shows a vessel.

    Parameters
    ----------
    folder : Path
        The masks' folder, for the message.
    masks : collection of ndarray
        All masks.

    Raises
    ------
    InputError
        If all are empty.
    """
    if not any(mask.any() for mask in masks):
        raise InputError(f"{folder}: expected masks with a vessel, received {len(masks)} empty ones")


def _is_image(path: Path) -> bool:
    # What begins with a dot is a system's own, such as the ._name.png that macOS leaves next to name.png.
    if path.name.startswith(".") or not path.is_file():
        return False
    return path.suffix.lower() in IMAGE_SUFFIXES or is_dicom(path)


def _eight_bits(path: Path, decoded: Decoded) -> np.ndarray:
    """Return the values of a picture scaled so that 255 is white."""
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
