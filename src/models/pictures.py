"""Small pictures of frames with their masks for notebooks: PNG in HTML."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from html import escape

import numpy as np

SHOWN, SIDE_PX = 6, 160
# Outline of a mask: orange, which no ultrasound picture has.
OUTLINE = (255, 140, 0)


def frames_picture(
    images: Sequence[np.ndarray] | np.ndarray,
    masks: Sequence[np.ndarray] | np.ndarray,
    names: Sequence[str] | None = None,
) -> str:
    """Draw some frames, evenly chosen, with the outlines of their masks.

    Parameters
    ----------
    images : sequence of ndarray, shape (h, w) or (h, w, 3)
        Grey or RGB frames of uint8, or probabilities of 0 to 1.
    masks : sequence of ndarray of bool, shape (h, w)
        Their masks.
    names : sequence of str or None, optional
        What to call each frame; None numbers them.

    Returns
    -------
    str
        HTML with at most ``SHOWN`` pictures, each at most ``SIDE_PX`` high and wide.
    """
    chosen = np.unique(np.linspace(0, len(masks) - 1, min(SHOWN, len(masks))).round().astype(int)).tolist()
    figures = []
    for at in chosen:
        name = escape(f"frame {at}" if names is None else str(names[at]))
        data = base64.b64encode(png(_outlined(np.asarray(images[at]), np.asarray(masks[at])))).decode()
        figures.append(
            f'<figure style="display:inline-block;margin:2px"><img alt="{name} with the outline of its mask" '
            f'src="data:image/png;base64,{data}"><figcaption><small>{name}</small></figcaption></figure>'
        )
    return f"<div>{''.join(figures)}</div>"


def png(pixels: np.ndarray) -> bytes:
    """Encode an RGB picture.

    Parameters
    ----------
    pixels : ndarray of uint8, shape (h, w, 3)
        The picture.

    Returns
    -------
    bytes
        A PNG file.
    """
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "PNG")
    return stream.getvalue()


def _outlined(image: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Every so many-th pixel in RGB, those on the border of the mask in the colour of the outline."""
    step = max(1, -(-max(mask.shape) // SIDE_PX))
    image, mask = image[::step, ::step], mask[::step, ::step]
    grey = (255 * image).clip(0, 255) if np.issubdtype(image.dtype, np.floating) else image
    pixels = np.array(
        np.broadcast_to(grey if grey.ndim == 3 else grey[..., None], (*mask.shape, 3)), dtype=np.uint8
    )
    padded = np.pad(mask, 1, mode="edge")
    whole = padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
    pixels[mask & ~whole] = OUTLINE
    return pixels
