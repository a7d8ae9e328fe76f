"""From a grey frame of any size to the network's input, and back: the same stage in training and in inference."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from models.errors import InputError
from models.shapes import Bool, Float32, Shaped, UInt8

NORMALISATIONS = ("standard", "unit")
# ITU-R BT.601 luma, what a grey conversion of a colour screen means.
LUMA = (0.299, 0.587, 0.114)


def to_grey(image: UInt8[np.ndarray, "*size"]) -> UInt8[np.ndarray, "h w"]:
    """A grey image of one with 1 (h, w), 3 (RGB) or 4 (RGBA, alpha ignored) channels last."""
    if image.ndim == 2:
        return image
    if image.ndim != 3 or image.shape[2] not in (3, 4):
        raise InputError(f"image: expected shape (h, w), (h, w, 3) or (h, w, 4), received {image.shape}")
    red, green, blue = (image[..., channel] for channel in range(3))
    if np.array_equal(red, green) and np.array_equal(green, blue):
        return np.ascontiguousarray(red)
    return np.rint(image[..., :3] @ np.array(LUMA)).astype(np.uint8)


@dataclass(frozen=True)
class Placement:
    """Where a frame of ``native`` (height, width) lies in the network's square: ``size`` pixels from ``corner``."""

    native: tuple[int, int]
    size: tuple[int, int]
    corner: tuple[int, int]

    @property
    def window(self) -> tuple[slice, slice]:
        """Rows and columns of the square that the frame fills."""
        (top, left), (height, width) = self.corner, self.size
        return slice(top, top + height), slice(left, left + width)


@dataclass(frozen=True)
class Preprocessing:
    """Resize to fit a square of ``image_size_px``, aspect kept, centred on black; then normalise the grey values.

    ``normalisation``: ``standard`` gives each image mean 0 and deviation 1, ``unit`` maps 0 to 255 to 0 to 1.
    """

    image_size_px: int
    normalisation: str = "standard"

    def __post_init__(self) -> None:
        if self.image_size_px < 1:
            raise InputError(f"image_size_px: expected a positive size, received {self.image_size_px}")
        if self.normalisation not in NORMALISATIONS:
            raise InputError(
                f"normalisation: expected one of {', '.join(NORMALISATIONS)}, received {self.normalisation!r}"
            )

    def placement(self, height: int, width: int) -> Placement:
        """Where a frame of that size goes."""
        scale = self.image_size_px / max(height, width)
        size = (max(1, round(height * scale)), max(1, round(width * scale)))
        corner = ((self.image_size_px - size[0]) // 2, (self.image_size_px - size[1]) // 2)
        return Placement((height, width), size, corner)

    def __call__(self, frames: UInt8[Tensor, "n h w"]) -> Float32[Tensor, "n 1 s s"]:
        """Grey frames of one size, resized with anti-aliasing and placed; values 0 to 1, not yet normalised."""
        return self._place(frames.float().div_(255))

    def mask(self, masks: Bool[Tensor, "n h w"]) -> Float32[Tensor, "n 1 s s"]:
        """Masks that follow their frames: 1 where vessel fills at least half of a pixel, else 0."""
        return (self._place(masks.float()) >= 0.5).float()

    def normalise(self, images: Float32[Tensor, "n 1 s s"]) -> Float32[Tensor, "n 1 s s"]:
        """The grey values as the network gets them; a uniform image becomes 0."""
        if self.normalisation == "unit":
            return images
        mean = images.mean(dim=(1, 2, 3), keepdim=True)
        deviation = images.std(dim=(1, 2, 3), keepdim=True, unbiased=False)
        return (images - mean) / deviation.clamp_min(1e-3)

    def restore(
        self, maps: Float32[Tensor, "n 1 s s"], placement: Placement
    ) -> Float32[Tensor, "n height width"]:
        """Bring maps of the network's size back to the native one, bilinearly; the padding is cut off."""
        rows, columns = placement.window
        native = functional.interpolate(
            maps[..., rows, columns],
            size=placement.native,
            mode="bilinear",
            align_corners=False,
            antialias=True,
        )
        return native[:, 0]

    def _place(self, images: Shaped[Tensor, "n h w"]) -> Tensor:
        placement = self.placement(images.shape[-2], images.shape[-1])
        square = images.new_zeros((len(images), 1, self.image_size_px, self.image_size_px))
        rows, columns = placement.window
        square[..., rows, columns] = functional.interpolate(
            images[:, None], size=placement.size, mode="bilinear", align_corners=False, antialias=True
        )
        return torch.clamp(square, 0, 1)
