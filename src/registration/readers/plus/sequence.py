"""A PLUS sequence as it lies in a file: pixels in orientation MF, and text fields for the file and for every frame."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from registration.errors import InputError

FRAME_FIELD = re.compile(r"^Seq_Frame(\d+)_(\S+)$")

# Letters of PLUS's image orientations: which way the first and second axis run (Marked or Unmarked side, Far from
# or Near to the transducer). A third letter (Ascending, Descending) speaks of stacking in volumes, not of frames.
_ALONG_COLUMNS, _ALONG_ROWS = "MU", "FN"


@dataclass(frozen=True)
class PlusSequence:
    """Everything in a sequence file.

    Parameters
    ----------
    pixels : ndarray, shape (n, height, width) or (n, height, width, channels)
        Pixels of the file's own type, orientation MF; a file of the tracker alone has frames of 0 by 0 px.
    frame_fields : tuple of mapping of str to str
        Fields of each frame as text (``Timestamp``, ``ProbeToTrackerTransform``, ...).
    header : mapping of str to str, optional
        Fields that concern the whole file.
    """

    pixels: np.ndarray
    frame_fields: tuple[Mapping[str, str], ...]
    header: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.pixels.ndim not in (3, 4) or len(self.pixels) != len(self.frame_fields):
            raise InputError(
                f"pixels: expected shape ({len(self.frame_fields)}, height, width) for as many frames with "
                f"fields, received {self.pixels.shape}"
            )

    @property
    def tracker_only(self) -> bool:
        """Whether the frames have no pixels."""
        return self.pixels.size == 0


def is_placeholder(width: int, height: int) -> bool:
    """Tell whether frames of this size stand for no image: PLUS gives poses alone 0 by 0 pixels, or 1 by 1.

    Parameters
    ----------
    width : int
        Width in px.
    height : int
        Height in px.

    Returns
    -------
    bool
        Whether there is no image.
    """
    return 0 in (width, height) or (width, height) == (1, 1)


def split_fields(fields: Mapping[str, str], path: Path) -> tuple[dict[str, str], dict[int, dict[str, str]]]:
    """Part the fields of a file from those of its frames (``Seq_Frame0012_Timestamp`` is of frame 12).

    Parameters
    ----------
    fields : mapping of str to str
        All fields.
    path : Path
        Name of the file, for messages.

    Returns
    -------
    header : dict of str to str
        Fields of the file.
    frames : dict of int to dict of str to str
        Fields of each frame by its number.

    Raises
    ------
    InputError
        If there are no fields.
    """
    header: dict[str, str] = {}
    by_frame: dict[int, dict[str, str]] = {}
    for key, value in fields.items():
        matched = FRAME_FIELD.match(key)
        if matched:
            by_frame.setdefault(int(matched[1]), {})[matched[2]] = value
        else:
            header[key] = value
    if not by_frame and not header:
        raise InputError(f"{path}: expected a header, found none")
    return header, by_frame


def numbered_fields(frame_fields: tuple[Mapping[str, str], ...]) -> list[tuple[str, str]]:
    """List the frames' fields under the names that they carry in a file.

    Parameters
    ----------
    frame_fields : tuple of mapping of str to str
        Fields of each frame.

    Returns
    -------
    list of (str, str)
        Names and values.
    """
    return [
        (f"Seq_Frame{number:04d}_{key}", value)
        for number, fields in enumerate(frame_fields)
        for key, value in fields.items()
    ]


def to_mf(pixels: np.ndarray, orientation: str, path: Path) -> np.ndarray:
    """Turn frames stored in one of PLUS's orientations into MF.

    MF runs along columns to the marked side and along rows away from the transducer.

    Parameters
    ----------
    pixels : ndarray, shape (n, rows, columns, ...)
        Frames as stored.
    orientation : str
        Orientation that they are in.
    path : Path
        Name of the file, for messages.

    Returns
    -------
    ndarray
        Frames in orientation MF.

    Raises
    ------
    InputError
        If the orientation is unknown.
    """
    letters = orientation.strip().upper()
    first, second = letters[:1], letters[1:2]
    if len(letters) not in (2, 3) or letters[2:] not in ("", "A", "D"):
        first = ""
    if first in _ALONG_ROWS and first and second in _ALONG_COLUMNS:
        pixels, first, second = np.swapaxes(pixels, 1, 2), second, first
    if not (first and first in _ALONG_COLUMNS and second in _ALONG_ROWS):
        raise InputError(
            f"{path}: expected an image orientation of M or U and F or N (MF, MFA, UF, MN, FM, ...), "
            f"found {orientation!r}"
        )
    if first == "U":
        pixels = pixels[:, :, ::-1]
    if second == "N":
        pixels = pixels[:, ::-1]
    return np.ascontiguousarray(pixels)
