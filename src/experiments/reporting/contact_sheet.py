"""Contact sheets: many images in one, for visual inspection."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, UInt8
from scipy.ndimage import binary_erosion

from registration.errors import InputError

GAP_PX = 4


def contact_sheet(
    rows: Sequence[Sequence[UInt8[np.ndarray, "_h _w"]]], tile_px: int
) -> UInt8[np.ndarray, "height width"]:
    """Lay images out in rows, each scaled to fit a square tile without changing its shape.

    Parameters
    ----------
    rows : sequence of sequence of ndarray of uint8
        Images of each row; they may differ in size.
    tile_px : int
        Side of a tile in px.

    Returns
    -------
    ndarray of uint8, shape (height, width)
        The contact sheet.

    Raises
    ------
    InputError
        If there is no row or a row is empty.
    """
    if not rows or not all(rows):
        raise InputError("rows: expected at least one picture in each row, received none")
    most = max(len(row) for row in rows)
    sheet = np.zeros((len(rows) * (tile_px + GAP_PX), most * (tile_px + GAP_PX)), dtype=np.uint8)
    for across, row in enumerate(rows):
        for along, picture in enumerate(row):
            tile = _fitted(picture, tile_px)
            top, left = across * (tile_px + GAP_PX), along * (tile_px + GAP_PX)
            sheet[top : top + tile.shape[0], left : left + tile.shape[1]] = tile
    return sheet


def outlined(picture: UInt8[np.ndarray, "h w"], mask: Bool[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w"]:
    """Draw the border of a mask in white.

    Parameters
    ----------
    picture : ndarray of uint8, shape (h, w)
        Image to draw on; it is not changed.
    mask : ndarray of bool, shape (h, w)
        Mask to outline.

    Returns
    -------
    ndarray of uint8, shape (h, w)
        A copy with the border drawn.
    """
    inner = binary_erosion(mask, border_value=1)
    return np.where(mask & ~inner, np.uint8(255), picture)


def _fitted(picture: UInt8[np.ndarray, "h w"], tile_px: int) -> UInt8[np.ndarray, "a b"]:
    from PIL import Image

    scale = tile_px / max(picture.shape)
    size = max(1, round(picture.shape[1] * scale)), max(1, round(picture.shape[0] * scale))
    return np.asarray(Image.fromarray(picture).resize(size, Image.Resampling.LANCZOS))
