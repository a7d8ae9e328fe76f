"""Frames as they come: one, a stack of equal ones, or many of mixed sizes, grey or in colour."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np

from models.array_types import Shaped, UInt8
from models.errors import InputError
from models.preprocessing.grey import echo_grey

CHANNELS = (3, 4)
SHAPES = "(height, width) or (height, width, 3), or a stack or a list of such frames"


@dataclass(frozen=True, eq=False)
class Frame:
    """One frame, with the size of its pixels where that is known.

    Parameters
    ----------
    image : ndarray of uint8, shape (h, w), (h, w, 3) or (h, w, 4)
        Grey, RGB or RGBA frame.
    spacing_mm : tuple of float or None, optional
        Vertical and horizontal size of a pixel in mm; None where unknown.

    Raises
    ------
    InputError
        If the frame has another shape or type.
    """

    image: Shaped[np.ndarray, "..."]
    spacing_mm: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        shape = self.image.shape
        is_frame = len(shape) == 2 or (len(shape) == 3 and shape[2] in CHANNELS)
        if self.image.dtype != np.uint8 or not is_frame or 0 in shape:
            raise InputError(f"frames: expected uint8 of shape {SHAPES}, received {self.image.dtype} {shape}")

    @property
    def size(self) -> tuple[int, int]:
        """Height and width in px."""
        return int(self.image.shape[0]), int(self.image.shape[1])

    @property
    def grey(self) -> UInt8[np.ndarray, "h w"]:
        """Grey values of the echoes."""
        return np.asarray(self.image if self.image.ndim == 2 else echo_grey(self.image))


def frames_of(frames: object, spacing_mm: tuple[float, float] | None) -> list[Frame]:
    """List the frames that a caller hands over at once.

    Parameters
    ----------
    frames : ndarray or sequence of ndarray
        One frame, a stack or a sequence of frames of any sizes; an array of three axes of which the last has 3 or 4
        values is one frame in colour.
    spacing_mm : tuple of float or None
        Vertical and horizontal size of all their pixels in mm; None where unknown.

    Returns
    -------
    list of Frame
        Views of the frames.

    Raises
    ------
    InputError
        If a frame has another shape or type.
    """
    if isinstance(frames, np.ndarray):
        if is_one_frame(frames):
            return [Frame(frames, spacing_mm)]
        if frames.ndim not in (3, 4) or frames.dtype != np.uint8 or 0 in frames.shape[1:]:
            raise InputError(
                f"frames: expected uint8 of shape {SHAPES}, received {frames.dtype} {frames.shape}"
            )
    elif not isinstance(frames, (list, tuple)):
        raise InputError(f"frames: expected a numpy array or a list, received a {type(frames).__name__}")
    other = next((frame for frame in frames if not isinstance(frame, np.ndarray)), None)
    if other is not None:
        raise InputError(f"frames: expected numpy arrays, received a {type(other).__name__}")
    return [Frame(frame, spacing_mm) for frame in frames]


def is_one_frame(frames: object) -> bool:
    """Tell whether an array is one frame and not a stack.

    Parameters
    ----------
    frames : object
        What a caller handed over.

    Returns
    -------
    bool
        True for an array (h, w), or (h, w, c) with 3 or 4 channels.
    """
    if not isinstance(frames, np.ndarray):
        return False
    return frames.ndim == 2 or (frames.ndim == 3 and frames.shape[2] in CHANNELS)


def batches_of(frames: Iterable[Frame], batch_size: int) -> Iterator[list[Frame]]:
    """Take frames from a stream, some at a time.

    Parameters
    ----------
    frames : iterable of Frame
        Stream of frames.
    batch_size : int
        Most frames of a batch.

    Yields
    ------
    list of Frame
        The next frames.
    """
    stream = iter(frames)
    while batch := list(islice(stream, batch_size)):
        yield batch
