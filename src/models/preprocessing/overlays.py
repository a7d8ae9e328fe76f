"""Graphics that a scanner burns into its frames (text, cross-hairs, callipers, markers), found and painted over.

Two rules, each made to miss a graphic rather than to take an echo for one. Colour: an echo is grey, or tinted like the
whole screen, so a small patch of strong colour is a graphic. Grey: an echo swells and fades over some pixels, so a thin
stroke at the display's maximum with dark pixels next to it is a graphic. What is taken out gets the value of
the nearest pixel that stays, which keeps the grain of the speckle around it.
"""

from __future__ import annotations

import numpy as np

from models.array_types import Bool, UInt8

# Difference between the strongest and the weakest of the three channels from which a pixel is coloured. Tissue on
# the tinted screens of the USGRA data set stays below 45, the markers there reach 79 to 92.
COLOURED = 64
# Where a quarter of the pixels that are not dark has half of that, the screen is tinted and colour means nothing.
TINTED_SHARE, NOT_DARK = 0.25, 64
# Patches of colour wider than twice this are colour Doppler or a colour map, not a mark.
WIDEST_MARK_PX = 8
# The display's maximum, with room for compression with losses.
WHITE = 250
# A stroke is at most twice this wide, less one; half of the pixels next to it are darker by the first amount
# at least and three quarters by the second.
WIDEST_STROKE_PX = 3
HALF_DARKER, QUARTERS_DARKER = 80, 40
# The slanted and curved strokes of a letter are softened below white: a thin part of this grey and brighter is taken
# as a whole where strokes make up this share of it.
SOFT_WHITE, STROKE_SHARE = 160, 0.1
# The soft edge of letters reaches this far.
EDGE_PX = 2


def without_colour_marks(image: UInt8[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h w 3"]:
    """Remove small coloured graphics from an RGB frame.

    Parameters
    ----------
    image : ndarray of uint8, shape (h, w, 3)
        Colour frame.

    Returns
    -------
    ndarray of uint8, shape (h, w, 3)
        The frame without graphics; the same frame where there are none, or where the whole screen is tinted.
    """
    # Channel by channel: numpy takes ten times as long over an axis of three.
    red, green, blue = (image[..., channel] for channel in range(3))
    brightest = np.maximum(np.maximum(red, green), blue)
    colour = brightest - np.minimum(np.minimum(red, green), blue)
    coloured = colour >= COLOURED
    if not coloured.any() or _is_tinted(colour, brightest):
        return image
    parts, count, width_px = _parts(coloured)
    small = np.zeros(count + 1, dtype=bool)
    small[1:] = width_px <= WIDEST_MARK_PX
    return _painted_over(image, small[parts])


def without_white_strokes(frame: UInt8[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w"]:
    """Remove thin white graphics from a grey frame.

    Parameters
    ----------
    frame : ndarray of uint8, shape (h, w)
        Grey frame.

    Returns
    -------
    ndarray of uint8, shape (h, w)
        The frame without graphics; the same frame where there are none.
    """
    white = frame >= WHITE
    if not white.any():
        return frame
    strokes = _strokes(frame, white)
    return _painted_over(frame, strokes | _letters(frame, strokes)) if strokes.any() else frame


def _is_tinted(colour: np.ndarray, brightest: np.ndarray) -> bool:
    shown = brightest >= NOT_DARK
    return bool((colour[shown] >= COLOURED / 2).mean() > TINTED_SHARE)


def _strokes(frame: np.ndarray, white: np.ndarray) -> Bool[np.ndarray, "h w"]:
    """The white parts that are thin and end sharply."""
    from scipy import ndimage

    parts, count, width_px = _parts(white)
    # Each pixel next to a part gets its number; one between two parts counts for the one with the higher number.
    around = np.where(white, 0, ndimage.maximum_filter(parts, 3, mode="nearest"))
    neighbours = np.bincount(around.ravel(), minlength=count + 1)[1:]
    darker = 255 - frame
    stroke = np.zeros(count + 1, dtype=bool)
    stroke[1:] = (width_px <= WIDEST_STROKE_PX) & (neighbours > 0)
    for by, share in ((HALF_DARKER, 0.5), (QUARTERS_DARKER, 0.75)):
        dark = np.bincount(around[darker >= by], minlength=count + 1)[1:]
        stroke[1:] &= dark >= share * neighbours
    return np.asarray(stroke[parts])


def _letters(frame: np.ndarray, strokes: np.ndarray) -> Bool[np.ndarray, "h w"]:
    """The thin bright parts that consist of strokes to a good share."""
    parts, count, width_px = _parts(frame >= SOFT_WHITE)
    share = np.bincount(parts[strokes], minlength=count + 1) / np.bincount(parts.ravel(), minlength=count + 1)
    letter = np.zeros(count + 1, dtype=bool)
    letter[1:] = (width_px <= WIDEST_STROKE_PX) & (share[1:] >= STROKE_SHARE)
    return np.asarray(letter[parts])


def _parts(region: np.ndarray) -> tuple[np.ndarray, int, np.ndarray]:
    """Numbers of the connected parts from 1 (diagonals connect), how many, and the half-width of each in pixels."""
    from scipy import ndimage

    parts, count = ndimage.label(region, np.ones((3, 3)))
    inward = ndimage.distance_transform_cdt(region, "chessboard")
    return parts, count, np.asarray(ndimage.maximum(inward, parts, np.arange(1, count + 1)))


def _painted_over(image: np.ndarray, marks: np.ndarray) -> np.ndarray:
    """The image with the marks and their soft edges replaced by the nearest pixels that stay."""
    from scipy import ndimage

    if not marks.any():
        return image
    marks = ndimage.maximum_filter(marks, 2 * EDGE_PX + 1, mode="constant")
    if marks.all():
        return image
    nearest = ndimage.distance_transform_edt(marks, return_distances=False, return_indices=True)
    painted = image.copy()
    painted[marks] = image[tuple(nearest[:, marks])]
    return painted
