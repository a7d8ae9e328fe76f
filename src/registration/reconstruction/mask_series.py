"""Position, size and shape of each mask of a tracked sweep in the world, and differences between masks."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache, cached_property

import numpy as np
from jaxtyping import Bool, Float64, Int64

from registration import transforms

# Number of pixels that are compared; larger masks are sampled evenly.
MAX_PIXELS = 400

Box = tuple[slice, slice]


@dataclass(frozen=True)
class MaskSeries:
    """Position, size and shape of each mask of a sweep.

    Parameters
    ----------
    filled : ndarray of bool, shape (k, height, width)
        Pixels of the vessel.
    boxes : tuple of (slice, slice)
        Rows and columns that hold each mask.
    world_A_pixel : ndarray, shape (k, 4, 4)
        Affine matrix of each mask from pixels to world mm.
    shown : ndarray of bool, shape (k,)
        Masks that show a vessel.
    middle_mm : ndarray, shape (k, 3)
        Centroids in world mm.
    middle_px : ndarray, shape (k, 2)
        Centroids as (column, row) in px.
    radius_mm : ndarray, shape (k,)
        Radii of circles of the masks' areas.
    path_mm : ndarray, shape (k,)
        Length of the path of the image centre from the first mask to each.
    """

    filled: Bool[np.ndarray, "k height width"]
    boxes: tuple[Box, ...]
    world_A_pixel: Float64[np.ndarray, "k 4 4"]
    shown: Bool[np.ndarray, " k"]
    middle_mm: Float64[np.ndarray, "k 3"]
    middle_px: Float64[np.ndarray, "k 2"]
    radius_mm: Float64[np.ndarray, " k"]
    path_mm: Float64[np.ndarray, " k"]
    # How much of a mask's shape another's does not cover, by both numbers: rounds and sides ask for the same pairs.
    _uncovered: dict[tuple[int, int], float] = field(default_factory=dict, init=False, repr=False)

    @classmethod
    def of(cls, masks: np.ndarray, world_A_pixel: np.ndarray, level: float) -> MaskSeries:
        """Describe the masks of a sweep.

        Parameters
        ----------
        masks : ndarray of bool or float, shape (k, height, width)
            Masks or probability maps in the order of acquisition.
        world_A_pixel : ndarray, shape (k, 4, 4)
            Affine matrix of each mask from pixels to world mm.
        level : float
            Probability from which on a pixel is vessel.

        Returns
        -------
        MaskSeries
            The series.
        """
        filled = masks if masks.dtype == np.bool_ else masks >= level
        boxes = tuple(map(box_of, filled))
        pixels, middle_px = _pixels(filled, boxes)
        middle_mm = transforms.apply_each(world_A_pixel, np.pad(middle_px, ((0, 0), (0, 1))))
        area_mm2 = np.linalg.norm(np.cross(world_A_pixel[:, :3, 0], world_A_pixel[:, :3, 1]), axis=1)
        centre_px = np.array([0.5 * filled.shape[2], 0.5 * filled.shape[1], 0.0])
        centres_mm = transforms.apply_each(world_A_pixel, np.tile(centre_px, (len(filled), 1)))
        steps_mm = np.linalg.norm(np.diff(centres_mm, axis=0), axis=1)
        return cls(
            filled,
            boxes,
            world_A_pixel,
            pixels > 0,
            middle_mm,
            middle_px,
            np.sqrt(pixels * area_mm2 / np.pi),
            np.concatenate([[0.0], np.cumsum(steps_mm)]),
        )

    @cached_property
    def normals(self) -> Float64[np.ndarray, "k 3"]:
        """Unit normal of each image plane."""
        facing = np.cross(self.world_A_pixel[:, :3, 0], self.world_A_pixel[:, :3, 1])
        return facing / np.linalg.norm(facing, axis=1, keepdims=True)

    @cached_property
    def pixel_mm(self) -> Float64[np.ndarray, "k 2"]:
        """Size of a pixel along columns and rows in mm."""
        return np.linalg.norm(self.world_A_pixel[:, :3, :2], axis=1)

    @cached_property
    def drawn_mm(self) -> list[Float64[np.ndarray, "p 2"]]:
        """Evenly drawn pixels of each mask, as offsets in mm from its centroid along columns and rows."""
        found = []
        for frame, box in enumerate(self.boxes):
            row, column = np.nonzero(self.filled[frame][box])
            few = np.linspace(0, len(row) - 1, min(MAX_PIXELS, len(row))).astype(np.int64)
            place_px = np.stack([column[few] + box[1].start, row[few] + box[0].start], axis=1)
            offset_px = place_px - self.middle_px[frame]
            found.append(offset_px * self.pixel_mm[frame])
        return found

    def differences(self, frame: int, others: Int64[np.ndarray, " n"]) -> tuple[float, float, float]:
        """Compute how far a mask is from the prediction by others.

        Parameters
        ----------
        frame : int
            Number of the mask.
        others : ndarray of int, shape (n,)
            Numbers of the masks that predict it, at least two.

        Returns
        -------
        position : float
            Distance in the image plane of the centroid from the prediction, in median radii of the others.
        size : float
            Difference of the radius from the prediction, in median radii of the others; negative for a
            smaller mask.
        shape : float
            Share of the shape that differs (1 - DSC after alignment of centroid and area), 0 to 1.
        """
        median_radius_mm = float(np.median(self.radius_mm[others]))
        values = np.column_stack([self.middle_mm[others], self.radius_mm[others]])
        expected = _line_at(self.path_mm[others], values, float(self.path_mm[frame]))
        offset_mm = self.middle_mm[frame] - expected[:3]
        in_plane_mm = offset_mm - (offset_mm @ self.normals[frame]) * self.normals[frame]
        wider_mm = float(self.radius_mm[frame] - expected[3])
        # Two of the others need agree: shapes change fast where branches part, but not from one mask to the next.
        shape = float(np.sort(self._shape_differences(frame, others))[1])
        return float(np.linalg.norm(in_plane_mm)) / median_radius_mm, wider_mm / median_radius_mm, shape

    def _shape_differences(self, frame: int, others: Int64[np.ndarray, " n"]) -> Float64[np.ndarray, " n"]:
        """The share of a mask that others do not cover, once their middles and areas are the same (1 - DSC)."""
        pairs = [(frame, other) for other in others.tolist()]
        new = [other for _, other in (pair for pair in pairs if pair not in self._uncovered)]
        if new:
            found = self._compare_shapes(frame, np.array(new, dtype=np.int64)).tolist()
            self._uncovered.update(((frame, other), share) for other, share in zip(new, found, strict=True))
        return np.array([self._uncovered[pair] for pair in pairs])

    def _compare_shapes(self, frame: int, others: Int64[np.ndarray, " n"]) -> Float64[np.ndarray, " n"]:
        scale = self.radius_mm[others] / self.radius_mm[frame]
        offset_px = scale[:, None, None] * self.drawn_mm[frame] / self.pixel_mm[others][:, None]
        place = np.rint(self.middle_px[others][:, None] + offset_px).astype(np.int64)
        column, row = place[..., 0], place[..., 1]
        height, width = self.filled.shape[1:]
        # Pixels beyond the image border are unknown and do not count.
        there = (column >= 0) & (row >= 0) & (column < width) & (row < height)
        inside = np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)
        covered = (self.filled[others[:, None], *inside] & there).sum(axis=1)
        known = there.sum(axis=1)
        return 1 - covered / np.maximum(known, 1)


def box_of(filled: Bool[np.ndarray, "height width"], margin_px: int = 0) -> Box:
    """Find the smallest rows and columns that hold a mask: a vessel takes little of an image.

    Parameters
    ----------
    filled : ndarray of bool, shape (height, width)
        Mask.
    margin_px : int, optional
        Further pixels on every side, as far as the image goes.

    Returns
    -------
    (slice, slice)
        Rows and columns; empty slices for an empty mask.
    """
    rows, columns = np.flatnonzero(filled.any(axis=1)), np.flatnonzero(filled.any(axis=0))
    if not len(rows):
        return slice(0, 0), slice(0, 0)
    height, width = filled.shape
    return (
        slice(max(rows[0] - margin_px, 0), min(rows[-1] + margin_px + 1, height)),
        slice(max(columns[0] - margin_px, 0), min(columns[-1] + margin_px + 1, width)),
    )


def _pixels(
    filled: Bool[np.ndarray, "k height width"], boxes: tuple[Box, ...]
) -> tuple[Int64[np.ndarray, " k"], Float64[np.ndarray, "k 2"]]:
    """The number of pixels of each mask, and its centroid as (column, row); 0 for an empty one."""
    pixels, middle_px = np.zeros(len(filled), dtype=np.int64), np.zeros((len(filled), 2))
    for frame, box in enumerate(boxes):
        own = filled[frame][box]
        pixels[frame] = own.sum()
        for axis in (0, 1):
            places = np.arange(box[1 - axis].start, box[1 - axis].stop)
            middle_px[frame, axis] = own.sum(axis=axis) @ places / max(pixels[frame], 1)
    return pixels, middle_px


def _line_at(
    path_mm: Float64[np.ndarray, " n"], values: Float64[np.ndarray, "n d"], place_mm: float
) -> Float64[np.ndarray, " d"]:
    """Values at a place by the line of median slope through others."""
    first, second = _pairs(len(path_mm))
    run_mm = path_mm[second] - path_mm[first]
    moving = run_mm > 1e-6
    if not moving.any():
        return _medians(values)
    slope = _medians((values[second[moving]] - values[first[moving]]) / run_mm[moving, None])
    return _medians(values + (place_mm - path_mm)[:, None] * slope)


@cache
def _pairs(count: int) -> tuple[Int64[np.ndarray, " p"], Int64[np.ndarray, " p"]]:
    """The pairs of so many places, of which there are no more than a window and its half have."""
    return np.triu_indices(count, 1)


def _medians(values: Float64[np.ndarray, "n d"]) -> Float64[np.ndarray, " d"]:
    """The median of each column; ``np.median`` takes several times as long for columns as short as these."""
    ordered = np.sort(values, axis=0)
    return np.asarray(0.5 * (ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2]))
