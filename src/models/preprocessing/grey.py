"""Colour frames as grey ones: by one function for training and inference, since neither sees the colour afterwards."""

from __future__ import annotations

import numpy as np

from models.array_types import UInt8
from models.errors import InputError
from models.preprocessing.overlays import without_colour_marks

# ITU-R BT.601 luma, what a grey conversion of a colour screen means.
LUMA = (0.299, 0.587, 0.114)


def to_grey(image: UInt8[np.ndarray, "*size"]) -> UInt8[np.ndarray, "h w"]:
    """Convert an image to grey.

    Parameters
    ----------
    image : ndarray of uint8, shape (h, w), (h, w, 3) or (h, w, 4)
        Grey, RGB or RGBA image; alpha is ignored.

    Returns
    -------
    ndarray of uint8, shape (h, w)
        Grey image.

    Raises
    ------
    InputError
        If the image has another shape.
    """
    if image.ndim == 2:
        return image
    if image.ndim != 3 or image.shape[2] not in (3, 4):
        raise InputError(f"image: expected shape (h, w), (h, w, 3) or (h, w, 4), received {image.shape}")
    red, green, blue = (image[..., channel] for channel in range(3))
    if np.array_equal(red, green) and np.array_equal(green, blue):
        return np.ascontiguousarray(red)
    return np.rint(image[..., :3] @ np.array(LUMA)).astype(np.uint8)


def echo_grey(image: UInt8[np.ndarray, "*size"]) -> UInt8[np.ndarray, "h w"]:
    """Convert a frame to the grey values of its echoes; small coloured graphics are removed first.

    Data sets read their images so and the predictor takes colour frames so, whatever a network's settings are.

    Parameters
    ----------
    image : ndarray of uint8, shape (h, w), (h, w, 3) or (h, w, 4)
        Frame as recorded.

    Returns
    -------
    ndarray of uint8, shape (h, w)
        Grey frame.
    """
    if image.ndim == 3 and image.shape[2] in (3, 4):
        image = without_colour_marks(image[..., :3])
    return to_grey(image)
