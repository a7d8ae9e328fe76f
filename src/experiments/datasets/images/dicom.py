"""Ultrasound frames from DICOM files: grey values, pixel size and region of the picture, through pydicom.

Attributes and their meaning: DICOM PS3.3, C.7.6.3 (Image Pixel).
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import UInt8

from experiments.datasets.images.dicom_geometry import region_of, spacing_mm_of
from experiments.datasets.images.dicom_grey import GreyDisplay, has_window
from experiments.errors import InputError, reading
from models.preprocessing.grey import echo_grey
from registration.input_files import require_unpacked_size

if TYPE_CHECKING:
    from pydicom import Dataset

SUFFIX = ".dcm"
_GREY = ("MONOCHROME1", "MONOCHROME2")
_INSTALL_DECODERS = "pip install pylibjpeg pylibjpeg-libjpeg pylibjpeg-openjpeg"


# A file for exchange begins with 128 bytes of anything and this (DICOM PS3.10, 7.1).
_PREAMBLE, _MAGIC = 128, b"DICM"


@dataclass(frozen=True)
class DicomFrames:
    """The frames of one DICOM file.

    Parameters
    ----------
    images : ndarray of uint8, shape (n, h, w)
        Grey values, n from 1.
    spacing_mm : (float, float) or None
        Pixel size (vertical, horizontal); None where the file has none.
    region_px : (int, int, int, int) or None
        Box of the 2-D tissue picture (top, left, bottom, right; the last two exclusive); None where the file
        has none.
    """

    images: UInt8[np.ndarray, "n h w"]
    spacing_mm: tuple[float, float] | None
    region_px: tuple[int, int, int, int] | None

    @property
    def sector(self) -> tuple[tuple[float, float], ...] | None:
        """The region's corners as shares of height and width, as ``models.preprocessing`` takes a sector."""
        if self.region_px is None:
            return None
        height, width = self.images.shape[1:]
        top, left, bottom, right = self.region_px
        corners = ((top, left), (bottom, left), (bottom, right), (top, right))
        return tuple((row / height, column / width) for row, column in corners)


def is_dicom(path: Path) -> bool:
    """Return whether a file is DICOM, by its suffix or by its content.

    Parameters
    ----------
    path : Path
        Any file.

    Returns
    -------
    bool
        False for the directory of a medium (DICOMDIR) too.
    """
    if path.suffix.lower() == SUFFIX:
        return True
    if path.name.casefold() == "dicomdir":
        return False
    try:
        with path.open("rb") as stream:
            return stream.read(_PREAMBLE + len(_MAGIC))[_PREAMBLE:] == _MAGIC
    except OSError:
        return False


def read_dicom(path: Path) -> DicomFrames:
    """Read a DICOM file of one or several frames.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    DicomFrames
        Grey values, pixel size and region of the picture.

    Raises
    ------
    InputError
        If the file is missing, damaged or truncated, has no pixels, signed pixels without a window or frames
        of different pixel sizes, or no installed package reads its compression.

    Notes
    -----
    Colour (RGB, YBR, palette) becomes grey as colour frames do anywhere; grey values go through the file's
    window, else by the bits stored (see ``GreyDisplay``); MONOCHROME1 is inverted. The pixel size is that of
    the largest 2-D tissue region in cm, else PixelSpacing, also where the functional groups of an enhanced
    file have it, else unknown.
    """
    try:
        import pydicom  # noqa: F401
    except ModuleNotFoundError as missing:
        raise InputError(
            f"{path}: expected the package pydicom to read DICOM, found none; pip install pydicom"
        ) from missing
    if not path.is_file():
        raise InputError(f"{path}: expected a DICOM file, found none")
    with warnings.catch_warnings():
        # What pydicom warns of either does no harm or ends in a refusal here.
        warnings.simplefilter("ignore")
        return _read(path)


def _read(path: Path) -> DicomFrames:
    import pydicom

    with reading(path, "a DICOM file"):
        content = pydicom.dcmread(path)
        _require_pixels(path, content)
    with reading(path, "whole frames that can be decoded"):
        images = _images(path, content)
        spacing_mm, box = spacing_mm_of(content), region_of(content, *images.shape[1:])
    return DicomFrames(images, spacing_mm, box)


def _require_pixels(path: Path, content: Dataset) -> None:
    """Raise InputError unless there are pixels in a form, and a compression, that can be read."""
    from pydicom.pixels.decoders.base import get_decoder

    if "PixelData" not in content:
        raise InputError(
            f"{path}: expected a DICOM file with frames, received one of modality "
            f"{content.get('Modality', 'unknown')} without pixels"
        )
    if content.get("PixelRepresentation", 0) != 0 and not has_window(content):
        raise InputError(
            f"{path}: expected unsigned pixels, or a window (WindowCenter, WindowWidth), received signed ones without"
        )
    syntax = getattr(getattr(content, "file_meta", None), "TransferSyntaxUID", None)
    if syntax is None:
        raise InputError(
            f"{path}: expected a DICOM file that names its transfer syntax, received one without"
        )
    try:
        available = get_decoder(syntax).is_available
    except NotImplementedError as error:
        raise InputError(
            f"{path}: expected frames that pydicom can decode, received {syntax.name}; "
            "convert the file to another transfer syntax first"
        ) from error
    if not available:
        raise InputError(
            f"{path}: expected a package that decodes {syntax.name}, found none; {_INSTALL_DECODERS}"
        )


def _images(path: Path, content: Dataset) -> np.ndarray:
    """Grey frames (n, height, width), decoded one by one: a long colour sequence would fill the memory."""
    count = int(content.get("NumberOfFrames") or 1)
    _require_memory(path, content, count)
    images = np.empty((count, int(content.Rows), int(content.Columns)), dtype=np.uint8)
    if images.size == 0:
        raise ValueError(f"{count} frames of {content.Rows} x {content.Columns} pixels")
    display = GreyDisplay(content)
    read = 0
    for read, frame in enumerate(_decoded(content), start=1):
        if read <= count:
            images[read - 1] = _grey(frame, content, display, read - 1)
    if read != count:
        raise ValueError(f"{read} frames where {count} are announced")
    display.require_plausible(path)
    return images


def _require_memory(path: Path, content: Dataset, count: int) -> None:
    """Uncompressed pixels must be there; of compressed ones there must be bytes for every frame, and not too few."""
    pixels = count * int(content.Rows) * int(content.Columns)
    require_unpacked_size(pixels, len(content.PixelData), path)
    if count > len(content.PixelData):
        raise ValueError(f"{count} frames in {len(content.PixelData)} bytes")


def _decoded(content: Dataset) -> Iterator[np.ndarray]:
    from pydicom.pixels.utils import iter_pixels

    # Colour comes as RGB, whatever colour space the file is in.
    return iter_pixels(content)


def _grey(frame: np.ndarray, content: Dataset, display: GreyDisplay, number: int) -> np.ndarray:
    from pydicom.pixels.processing import apply_color_lut

    interpretation = str(content.PhotometricInterpretation)
    if interpretation in _GREY:
        frame = display(frame, number)
        return 255 - frame if interpretation == "MONOCHROME1" else frame
    largest = 2 ** int(content.BitsStored) - 1
    if interpretation == "PALETTE COLOR":
        frame = apply_color_lut(frame, content)
        largest = np.iinfo(frame.dtype).max
    if largest != 255:
        frame = np.rint(np.minimum(frame, largest) * (255.0 / largest))
    return echo_grey(frame.astype(np.uint8))
