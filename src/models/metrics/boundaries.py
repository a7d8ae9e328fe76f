"""The boundary of a 2-D mask, as pixels or as contour elements, and distances from one boundary to another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.array_types import Bool, Float64

# Up to so many pairs of points a table of all distances is made sooner than two search trees.
TABLE_ENTRIES = 40_000


@dataclass(frozen=True)
class Boundary:
    """Points of a boundary, with the contour length that each one stands for.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
        Positions (row, column) in mm, or in px for a spacing of one.
    lengths : ndarray, shape (n,)
        Contour lengths in the same unit.
    """

    points: Float64[np.ndarray, "n 2"]
    lengths: Float64[np.ndarray, " n"]

    def __len__(self) -> int:
        return len(self.points)


def crop_to_union(
    first: Bool[np.ndarray, "h w"], second: Bool[np.ndarray, "h w"]
) -> tuple[Bool[np.ndarray, "a b"], Bool[np.ndarray, "a b"]]:
    """Crop two masks to the bounding box of their union, framed by one empty pixel on each side.

    Distances between boundaries do not change, and most of a vessel's image is background.

    Parameters
    ----------
    first, second : ndarray of bool, shape (h, w)
        Masks of one size.

    Returns
    -------
    tuple of two ndarrays of bool, shape (a, b)
        Cropped and framed masks.
    """
    union = first | second
    rows, columns = np.flatnonzero(union.any(axis=1)), np.flatnonzero(union.any(axis=0))
    if not len(rows):
        return np.zeros((2, 2), bool), np.zeros((2, 2), bool)
    box = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
    shape = (rows[-1] - rows[0] + 3, columns[-1] - columns[0] + 3)
    framed = np.zeros((2, *shape), bool)
    framed[0, 1:-1, 1:-1] = first[box]
    framed[1, 1:-1, 1:-1] = second[box]
    return framed[0], framed[1]


def boundary_pixels(mask: Bool[np.ndarray, "a b"], spacing: tuple[float, float]) -> Boundary:
    """Find the centres of mask pixels that have a background pixel above, below, left or right of them.

    Parameters
    ----------
    mask : ndarray of bool, shape (a, b)
        Mask framed by empty pixels.
    spacing : tuple of float
        Vertical and horizontal size of a pixel.

    Returns
    -------
    Boundary
        Points in the unit of ``spacing``, each of length 1.
    """
    inside = mask[1:-1, 1:-1]
    surrounded = mask[:-2, 1:-1] & mask[2:, 1:-1] & mask[1:-1, :-2] & mask[1:-1, 2:]
    on_boundary = inside & ~surrounded
    points = _places(on_boundary, spacing)
    return Boundary(points, np.ones(len(points)))


def boundary_elements(mask: Bool[np.ndarray, "a b"], spacing: tuple[float, float]) -> Boundary:
    """Find the contour elements of a mask: one at each pixel corner whose four pixels are not all alike.

    An element's length is that of marching squares through the four: a half diagonal where one pixel differs from the
    rest, two where opposite corners do, a pixel's side where the two rows or columns differ.

    Parameters
    ----------
    mask : ndarray of bool, shape (a, b)
        Mask framed by empty pixels.
    spacing : tuple of float
        Vertical and horizontal size of a pixel.

    Returns
    -------
    Boundary
        Points and lengths in the unit of ``spacing``.

    References
    ----------
    Elements weighted by length are the idea of surface-distance: S. Nikolov et al., J. Med. Internet Res. 23(7),
    2021.
    """
    bits = mask.view(np.uint8)
    code = bits[:-1, :-1] + 2 * bits[:-1, 1:] + 4 * bits[1:, :-1] + 8 * bits[1:, 1:]
    across, along = spacing[1], spacing[0]
    diagonal = 0.5 * float(np.hypot(along, across))
    lengths = np.full(16, diagonal)
    lengths[[0b0000, 0b1111]] = 0.0
    lengths[[0b0110, 0b1001]] = 2 * diagonal
    lengths[[0b0011, 0b1100]] = across
    lengths[[0b0101, 0b1010]] = along
    on_boundary = (code != 0b0000) & (code != 0b1111)
    return Boundary(_places(on_boundary, spacing), lengths[code[on_boundary]])


def _places(chosen: Bool[np.ndarray, "a b"], spacing: tuple[float, float]) -> Float64[np.ndarray, "n 2"]:
    """Where ``chosen`` is set, in row-major order."""
    rows, columns = np.divmod(np.flatnonzero(chosen), chosen.shape[1])
    points = np.empty((len(rows), 2))
    points[:, 0] = rows * spacing[0]
    points[:, 1] = columns * spacing[1]
    return points


def distances_between(
    first: Boundary, second: Boundary
) -> tuple[Float64[np.ndarray, " n"], Float64[np.ndarray, " m"]]:
    """Compute the distance from each point of one boundary to the nearest of the other, in both directions.

    Parameters
    ----------
    first, second : Boundary
        Boundaries in one unit.

    Returns
    -------
    forward : ndarray, shape (n,)
        Distances from ``first`` to ``second``; infinite if ``second`` is empty.
    backward : ndarray, shape (m,)
        Distances from ``second`` to ``first``; infinite if ``first`` is empty.
    """
    if not len(first) or not len(second):
        return np.full(len(first), np.inf), np.full(len(second), np.inf)
    if len(first) * len(second) <= TABLE_ENTRIES:
        squared = _squared(first.points, second.points)
        return np.sqrt(squared.min(axis=1)), np.sqrt(squared.min(axis=0))
    return _nearest(first.points, second.points), _nearest(second.points, first.points)


def _nearest(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    try:
        from scipy.spatial import cKDTree
    except ModuleNotFoundError:  # a training machine may have torch and lightning alone
        rows = max(1, 50 * TABLE_ENTRIES // len(end))
        blocks = (start[row : row + rows] for row in range(0, len(start), rows))
        return np.concatenate([np.sqrt(_squared(block, end).min(axis=1)) for block in blocks])
    return np.asarray(cKDTree(end, compact_nodes=False, balanced_tree=False).query(start)[0])


def _squared(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Squared distances of all pairs."""
    along, across = (np.subtract.outer(start[:, axis], end[:, axis]) for axis in (0, 1))
    along *= along
    across *= across
    along += across
    return along
