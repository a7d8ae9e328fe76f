"""From a frame of any size to the network's input, and back: the same stage in training and in inference.

A colour frame becomes grey when it is read from a file and when it is handed to the predictor, in both places by
``models.preprocessing.grey.echo_grey``. All else is set in ``Preprocessing``, which a checkpoint keeps with
the weights.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from models.array_types import Bool, Float32, Shaped, UInt8
from models.errors import InputError
from models.preprocessing.overlays import without_white_strokes
from models.preprocessing.sector import Corners, bounding_box, checked_corners, find_sector, sector_of

NORMALISATIONS = ("standard", "standard_sector", "unit")
SECTORS = ("none", "auto")
OVERLAYS = ("none", "auto")
# Half a grey level, in values of 0 to 1.
HALF_LEVEL = 0.5 / 255


@dataclass(frozen=True)
class Placement:
    """Where a frame lies in the network's square.

    Parameters
    ----------
    native : tuple of int
        Height and width of the frame in px.
    size : tuple of int
        Height and width in the square, in px.
    corner : tuple of int
        Top and left of the frame in the square, in px.
    box : tuple of int
        Part of the frame that is placed: top, left, bottom, right in px, the last two exclusive.
    """

    native: tuple[int, int]
    size: tuple[int, int]
    corner: tuple[int, int]
    box: tuple[int, int, int, int]

    @property
    def window(self) -> tuple[slice, slice]:
        """Rows and columns of the square that the frame fills."""
        (top, left), (height, width) = self.corner, self.size
        return slice(top, top + height), slice(left, left + width)


@dataclass(frozen=True)
class Preprocessing:
    """Cleaning, resizing to a square on black with the aspect kept, and normalisation of frames.

    Parameters
    ----------
    image_size_px : int
        Side of the square in px.
    normalisation : str
        ``standard`` gives each image mean 0 and deviation 1; ``standard_sector`` does so for its pixels brighter than
        its darkest grey, so that black around the sector does not count; ``unit`` maps 0 to 255 to 0 to 1.
    sector : str or sequence of sequences of float
        Where the echoes are; all outside becomes black. ``none`` leaves the frame as it is, ``auto`` finds the sector
        in each frame (``models.preprocessing.sector``), corners [row, column] as fractions of the frame's height and
        width set it for all.
    overlays : str
        ``auto`` removes thin white graphics (``models.preprocessing.overlays``), ``none`` nothing.
    crop : bool
        Whether the frame is cut to the bounding box of the corners.
    ground_tolerance : int
        Grey levels by which the dark ground around the sector varies: 0 for files (JPEG too), about 8 for grabbed
        video.

    Raises
    ------
    InputError
        If a setting is out of range or does not go with another.
    """

    image_size_px: int
    normalisation: str = "standard"
    sector: str | Sequence[Sequence[float]] = "none"
    overlays: str = "none"
    crop: bool = False
    ground_tolerance: int = 0

    def __post_init__(self) -> None:
        if self.image_size_px < 1:
            raise InputError(f"image_size_px: expected a positive size, received {self.image_size_px}")
        for name, known in (("normalisation", NORMALISATIONS), ("overlays", OVERLAYS)):
            if getattr(self, name) not in known:
                raise InputError(
                    f"{name}: expected one of {', '.join(known)}, received {getattr(self, name)!r}"
                )
        if self.sector not in SECTORS:
            object.__setattr__(self, "sector", checked_corners(self.sector))
        if self.crop and self._corners is None:
            raise InputError(f"crop: expected a sector given by its corners, received sector {self.sector}")
        if not 0 <= self.ground_tolerance <= 255:
            raise InputError(
                f"ground_tolerance: expected 0 to 255 grey levels, received {self.ground_tolerance}"
            )

    def placement(self, height: int, width: int) -> Placement:
        """Compute where a frame goes.

        Parameters
        ----------
        height, width : int
            Size of the frame in px.

        Returns
        -------
        Placement
            Its place in the square.
        """
        box = (0, 0, height, width)
        if self.crop and self._corners is not None:
            box = bounding_box(self._corners, height, width)
        rows, columns = box[2] - box[0], box[3] - box[1]
        scale = self.image_size_px / max(rows, columns)
        size = (max(1, round(rows * scale)), max(1, round(columns * scale)))
        corner = ((self.image_size_px - size[0]) // 2, (self.image_size_px - size[1]) // 2)
        return Placement((height, width), size, corner, box)

    def __call__(self, frames: UInt8[Tensor, "n h w"]) -> Float32[Tensor, "n 1 s s"]:
        """Clean and resize frames.

        Parameters
        ----------
        frames : Tensor of uint8, shape (n, h, w)
            Grey frames of one size.

        Returns
        -------
        Tensor, shape (n, 1, s, s)
            Images of values 0 to 1, not normalised.
        """
        if self.sector == "none" and self.overlays == "none":
            return self.resize(frames)
        return self.resize(torch.from_numpy(self.clean(frames.cpu().numpy())).to(frames.device))

    def clean(self, frames: UInt8[np.ndarray, "n h w"]) -> UInt8[np.ndarray, "n h w"]:
        """Remove burnt-in graphics and what lies outside the sector.

        Parameters
        ----------
        frames : ndarray of uint8, shape (n, h, w)
            Grey frames of one size.

        Returns
        -------
        ndarray of uint8, shape (n, h, w)
            Clean frames; the same array where there is nothing to do.
        """
        if self.sector == "none" and self.overlays == "none":
            return frames
        return np.stack([self._cleaned(frame) for frame in frames]) if len(frames) else frames

    def resize(self, frames: UInt8[Tensor, "n h w"]) -> Float32[Tensor, "n 1 s s"]:
        """Resize clean frames with anti-aliasing, and place them.

        Parameters
        ----------
        frames : Tensor of uint8, shape (n, h, w)
            Clean frames of one size.

        Returns
        -------
        Tensor, shape (n, 1, s, s)
            Images of values 0 to 1, not normalised.
        """
        return self._place(frames.float().div_(255))

    def mask(self, masks: Bool[Tensor, "n h w"]) -> Float32[Tensor, "n 1 s s"]:
        """Resize and place masks as their frames.

        Parameters
        ----------
        masks : Tensor of bool, shape (n, h, w)
            Masks of one size.

        Returns
        -------
        Tensor, shape (n, 1, s, s)
            1 where vessel fills at least half of a pixel, otherwise 0.
        """
        return (self._place(masks.float()) >= 0.5).float()

    def normalise(self, images: Float32[Tensor, "n 1 s s"]) -> Float32[Tensor, "n 1 s s"]:
        """Normalise grey values for the network.

        Parameters
        ----------
        images : Tensor, shape (n, 1, s, s)
            Images of values 0 to 1.

        Returns
        -------
        Tensor, shape (n, 1, s, s)
            Normalised images; a uniform image becomes 0.
        """
        if self.normalisation == "unit":
            return images
        if self.normalisation == "standard_sector":
            return _standard_of_the_lit(images)
        mean = images.mean(dim=(1, 2, 3), keepdim=True)
        deviation = images.std(dim=(1, 2, 3), keepdim=True, unbiased=False)
        return (images - mean) / deviation.clamp_min(1e-3)

    def restore(
        self, maps: Float32[Tensor, "n 1 s s"], placement: Placement
    ) -> Float32[Tensor, "n height width"]:
        """Bring maps of the network's size back to the native one, bilinearly.

        Parameters
        ----------
        maps : Tensor, shape (n, 1, s, s)
            Maps in the square.
        placement : Placement
            Where the frames lie in it.

        Returns
        -------
        Tensor, shape (n, height, width)
            Maps of the frames' size; 0 where the frame was cut off.
        """
        rows, columns = placement.window
        top, left, bottom, right = placement.box
        native = functional.interpolate(
            maps[..., rows, columns],
            size=(bottom - top, right - left),
            mode="bilinear",
            align_corners=False,
            antialias=True,
        )[:, 0]
        if (bottom - top, right - left) == placement.native:
            return native
        whole = native.new_zeros((len(native), *placement.native))
        whole[:, top:bottom, left:right] = native
        return whole

    @property
    def _corners(self) -> Corners | None:
        return None if isinstance(self.sector, str) else cast("Corners", self.sector)

    def _cleaned(self, frame: np.ndarray) -> np.ndarray:
        clean = without_white_strokes(frame) if self.overlays == "auto" else frame
        if self.sector == "none":
            return clean
        # The sector is that of the frame as it was: painting over changes nothing about where the echoes are.
        corners = self._corners
        inside = (
            find_sector(frame, self.ground_tolerance) if corners is None else sector_of(corners, *frame.shape)
        )
        return np.where(inside, clean, np.uint8(0))

    def _place(self, images: Shaped[Tensor, "n h w"]) -> Tensor:
        placement = self.placement(images.shape[-2], images.shape[-1])
        top, left, bottom, right = placement.box
        square = images.new_zeros((len(images), 1, self.image_size_px, self.image_size_px))
        rows, columns = placement.window
        square[..., rows, columns] = functional.interpolate(
            images[:, None, top:bottom, left:right],
            size=placement.size,
            mode="bilinear",
            align_corners=False,
            antialias=True,
        )
        return torch.clamp(square, 0, 1)


def _standard_of_the_lit(images: Tensor) -> Tensor:
    """Mean 0 and deviation 1 over the pixels of each image that are brighter than its darkest by half a grey level.

    Black around the sector stays the darkest whatever augmentation does to the brightness, so it needs no mask.
    """
    every = (1, 2, 3)
    lit = images > images.amin(dim=every, keepdim=True) + HALF_LEVEL
    lit = lit | ~lit.any(dim=3, keepdim=True).any(dim=2, keepdim=True)
    count = lit.sum(dim=every, keepdim=True)
    mean = (images * lit).sum(dim=every, keepdim=True) / count
    variance = ((images - mean).square() * lit).sum(dim=every, keepdim=True) / count
    return (images - mean) / variance.sqrt().clamp_min(1e-3)
