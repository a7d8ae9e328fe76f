"""Where in a frame the scanner shows echoes: its sector, found in the frame itself or given by corners.

A screen shows a linear probe's echoes as a rectangle and a curved or phased one's as a fan, on a dark ground with text,
scales and marks around it. Everything here is in pixels of the frame as it was recorded.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from models.array_types import Bool, UInt8
from models.errors import InputError

Corners = tuple[tuple[float, float], ...]

# The ground is the darkest grey that this share of the frame's outermost pixels has; it is never brighter than this.
GROUND_SHARE, BRIGHTEST_GROUND = 0.05, 32
# A part narrower than this share of the frame's shorter side is a letter, a scale or a line, not a sector.
THINNEST = 0.02
# A part of less than this share of the largest is text or a mark, anywhere and within the columns of the largest;
# larger ones belong to a sector that a shadow divides. Keeping a line of text does less harm than losing an echo.
SMALLEST_PART, SMALLEST_PART_BELOW = 0.1, 0.02
# A sector fills at least this share of a frame.
SMALLEST_SECTOR = 0.01
# Sides that lean outwards by this much make a fan; the smallest length of each is a share of the sector's height.
FAN_LEAN_DEG, FAN_SIDE = (5.0, 65.0), 0.15
# Upright sides and a level top of this share of the sector's height and width make a rectangle.
BOX_LEAN_DEG, BOX_SIDE = 1.0, 0.3


def find_sector(frame: UInt8[np.ndarray, "h w"], tolerance: int) -> Bool[np.ndarray, "h w"]:
    """Find the convex region of echoes on a dark ground; for a fan, without what lies above the probe's face.

    Whatever is more than ``tolerance`` grey levels brighter than the ground, dense and not thin belongs to it; dark
    areas within (vessels, shadows) and the dark corners of a rectangle do as well, and text and marks apart from it
    do not.

    Parameters
    ----------
    frame : ndarray of uint8, shape (h, w)
        Grey frame.
    tolerance : int
        Grey levels by which the ground varies.

    Returns
    -------
    ndarray of bool, shape (h, w)
        The sector; all of the frame where no ground can be seen around the echoes, or where there are no echoes at
        all.
    """
    ground = _ground(frame)
    if ground is None:
        return np.ones(frame.shape, dtype=bool)
    bright = frame > ground + tolerance
    echoes = _largest_parts(_solid(bright))
    if echoes.mean() < SMALLEST_SECTOR:
        return np.ones(frame.shape, dtype=bool)
    # The filters round corners; what is bright next to the echoes brings them back.
    corners = _hull(_dilated(echoes, 3) & bright)
    if _is_box(corners):
        (top, left), (bottom, right) = corners.min(axis=0), corners.max(axis=0)
        corners = np.array([(top, left), (bottom, left), (bottom, right), (top, right)])
    inside = _within(corners, frame.shape)
    apex = _apex(corners)
    return inside if apex is None else inside & _below_the_face(apex, echoes)


def checked_corners(corners: str | Sequence[Sequence[float]]) -> Corners:
    """Check the corners of a sector.

    Parameters
    ----------
    corners : str or sequence of sequences of float
        Corners (row, column) as fractions of the frame's height and width.

    Returns
    -------
    tuple of tuple of float
        The corners.

    Raises
    ------
    InputError
        If they are not corners, lie outside the frame, or enclose no area.
    """
    try:
        points = np.array(corners, dtype=np.float64)
    except (TypeError, ValueError):
        points = np.empty(0)
    if points.ndim != 2 or points.shape[0] < 3 or points.shape[1] != 2 or not np.isfinite(points).all():
        raise InputError(
            f"sector: expected none, auto or at least three corners [row, column], received {corners!r}"
        )
    if points.min() < 0 or points.max() > 1:
        raise InputError(
            f"sector: expected corners as shares 0 to 1 of the frame's height and width, received {corners!r}"
        )
    following = np.roll(points, -1, axis=0)
    if abs((points[:, 0] * following[:, 1] - points[:, 1] * following[:, 0]).sum()) < 1e-6:
        raise InputError(f"sector: expected corners that enclose an area, received {corners!r}")
    return tuple((float(row), float(column)) for row, column in points)


@lru_cache(maxsize=8)
def sector_of(corners: Corners, height: int, width: int) -> Bool[np.ndarray, "h w"]:
    """Draw the region within corners.

    Parameters
    ----------
    corners : tuple of tuple of float
        Corners (row, column) as fractions of height and width.
    height, width : int
        Size of the frame in px.

    Returns
    -------
    ndarray of bool, shape (height, width)
        The region, read-only.
    """
    from skimage.draw import polygon2mask

    # The share 0 is the outer edge of the first pixel, half a pixel before its centre.
    inside: np.ndarray = polygon2mask((height, width), np.array(corners) * (height, width) - 0.5)
    inside.flags.writeable = False
    return inside


def bounding_box(corners: Corners, height: int, width: int) -> tuple[int, int, int, int]:
    """Compute the bounding box of corners in pixels, at least one.

    Parameters
    ----------
    corners : tuple of tuple of float
        Corners (row, column) as fractions of height and width.
    height, width : int
        Size of the frame in px.

    Returns
    -------
    tuple of int
        Top, left, bottom and right; the last two exclusive.
    """
    (top, left), (bottom, right) = np.min(corners, axis=0), np.max(corners, axis=0)
    first = (min(int(top * height), height - 1), min(int(left * width), width - 1))
    return (
        *first,
        max(first[0] + 1, int(np.ceil(bottom * height))),
        max(first[1] + 1, int(np.ceil(right * width))),
    )


def _ground(frame: np.ndarray) -> int | None:
    """The grey of the ground around the sector; None where the outermost pixels show none."""
    border = np.concatenate([frame[0], frame[-1], frame[1:-1, 0], frame[1:-1, -1]])
    common = np.bincount(border, minlength=256)[: BRIGHTEST_GROUND + 1] >= GROUND_SHARE * border.size
    return int(np.argmax(common)) if common.any() else None


def _solid(bright: np.ndarray) -> np.ndarray:
    """Where bright pixels are dense, without what is thin."""
    from scipy import ndimage

    dense = ndimage.uniform_filter(bright.astype(np.float32), 5, mode="nearest") >= 0.5
    width = max(3, round(THINNEST * min(bright.shape)) | 1)
    eroded = ndimage.minimum_filter(dense, width, mode="nearest")
    opened: np.ndarray = ndimage.maximum_filter(eroded, width, mode="nearest")
    return opened


def _largest_parts(region: np.ndarray) -> np.ndarray:
    from scipy import ndimage

    parts, _ = ndimage.label(region)
    sizes = np.bincount(parts.ravel())
    sizes[0] = 0
    columns = np.flatnonzero((parts == sizes.argmax()).any(axis=0))
    below = np.bincount(parts[:, columns[0] : columns[-1] + 1].ravel(), minlength=len(sizes)) == sizes
    smallest = np.where(below, SMALLEST_PART_BELOW, SMALLEST_PART) * sizes.max()
    large: np.ndarray = ((sizes >= smallest) & (sizes > 0))[parts]
    return large


def _dilated(region: np.ndarray, by_px: int) -> np.ndarray:
    from scipy import ndimage

    wider: np.ndarray = ndimage.maximum_filter(region, 2 * by_px + 1, mode="nearest")
    return wider


def _hull(region: np.ndarray) -> np.ndarray:
    """Corners (c, 2) as (row, column) of the convex hull of whole pixels: down the left side, up the right one."""
    from scipy.spatial import ConvexHull

    rows = np.flatnonzero(region.any(axis=1))
    left = region[rows].argmax(axis=1) - 0.5
    right = region.shape[1] - region[rows, ::-1].argmax(axis=1) - 0.5
    sides = [np.column_stack([rows + half, columns]) for half in (-0.5, 0.5) for columns in (left, right)]
    points = np.concatenate(sides)
    corners: np.ndarray = points[ConvexHull(points).vertices]
    return corners


def _edges(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Each edge's vector as it goes down (where it isn't level), and -1 for the left side, 1 for the right, else 0."""
    along = np.roll(corners, -1, axis=0) - corners
    side = -np.sign(along[:, 0])
    return np.where(side[:, None] > 0, -along, along), side


def _within(corners: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """The pixels within convex corners: each row lies between the innermost of its left and of its right edges."""
    along, side = _edges(corners)
    rows, columns = np.arange(shape[0])[:, None], np.arange(shape[1])
    bounds = []
    for which, innermost in ((-1, np.max), (1, np.min)):
        (row, column), (down, across) = corners[side == which].T, along[side == which].T
        bounds.append(innermost(column + (rows - row) * across / down, axis=1, keepdims=True))
    shown = (rows >= corners[:, 0].min()) & (rows <= corners[:, 0].max())
    return np.asarray(shown & (columns >= bounds[0]) & (columns <= bounds[1]))


def _is_box(corners: np.ndarray) -> bool:
    along, side = _edges(corners)
    length = np.abs(along)
    height, width = np.ptp(corners, axis=0)
    lean = np.tan(np.radians(BOX_LEAN_DEG))
    upright = (length[:, 1] <= lean * length[:, 0]) & (length[:, 0] >= BOX_SIDE * height)
    level = (length[:, 0] <= lean * length[:, 1]) & (length[:, 1] >= BOX_SIDE * width)
    at_top = corners[:, 0] <= corners[:, 0].min() + lean * width
    return bool((upright & (side < 0)).any() and (upright & (side > 0)).any() and (level & at_top).any())


def _apex(corners: np.ndarray) -> np.ndarray | None:
    """Where the two straight sides of a fan would meet, (row, column); None for what is no fan."""
    along, side = _edges(corners)
    length = np.linalg.norm(along, axis=1)
    outwards_deg = side * np.degrees(np.arctan2(along[:, 1], along[:, 0]))
    straight = (outwards_deg >= FAN_LEAN_DEG[0]) & (outwards_deg <= FAN_LEAN_DEG[1])
    straight &= length >= FAN_SIDE * np.ptp(corners[:, 0])
    left, right = (int(np.argmax(np.where(straight & (side == which), length, 0))) for which in (-1, 1))
    if not (straight & (side < 0)).any() or not (straight & (side > 0)).any():
        return None
    steps = np.linalg.solve(np.column_stack([along[left], -along[right]]), corners[right] - corners[left])
    return np.asarray(corners[left] + steps[0] * along[left])


def _below_the_face(apex: np.ndarray, echoes: np.ndarray) -> np.ndarray:
    """Where a pixel is at least as far from the apex as (nearly) all echoes are: the probe's face is an arc."""
    row, column = np.ogrid[: echoes.shape[0], : echoes.shape[1]]
    distance = np.hypot(row - apex[0], column - apex[1])
    # One echo in two thousand may be nearer, and the arc is known to two pixels.
    return np.asarray(distance >= np.quantile(distance[echoes], 0.0005) - 2)
