"""Position, size and shape of each mask of a tracked sweep in the world, and differences between masks."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float64, Int64

from registration import transforms

# Number of pixels that are compared; larger masks are sampled evenly.
MAX_PIXELS = 400


@dataclass(frozen=True)
class MaskSeries:
    """Position, size and shape of each mask of a sweep.

    Parameters
    ----------
    filled : ndarray of bool, shape (k, height, width)
        Pixels of the vessel.
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
    world_A_pixel: Float64[np.ndarray, "k 4 4"]
    shown: Bool[np.ndarray, " k"]
    middle_mm: Float64[np.ndarray, "k 3"]
    middle_px: Float64[np.ndarray, "k 2"]
    radius_mm: Float64[np.ndarray, " k"]
    path_mm: Float64[np.ndarray, " k"]

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
        pixels = filled.sum(axis=(1, 2))
        weight = np.maximum(pixels, 1)
        across = filled.sum(axis=1) @ np.arange(filled.shape[2]) / weight
        down = filled.sum(axis=2) @ np.arange(filled.shape[1]) / weight
        middle_px = np.stack([across, down], axis=1)
        middle_mm = transforms.apply_each(world_A_pixel, np.pad(middle_px, ((0, 0), (0, 1))))
        area_mm2 = np.linalg.norm(np.cross(world_A_pixel[:, :3, 0], world_A_pixel[:, :3, 1]), axis=1)
        centre_px = np.array([0.5 * filled.shape[2], 0.5 * filled.shape[1], 0.0])
        centres_mm = transforms.apply_each(world_A_pixel, np.tile(centre_px, (len(filled), 1)))
        steps_mm = np.linalg.norm(np.diff(centres_mm, axis=0), axis=1)
        return cls(
            filled,
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
        for frame, own in enumerate(self.filled):
            row, column = np.nonzero(own)
            few = np.linspace(0, len(row) - 1, min(MAX_PIXELS, len(row))).astype(np.int64)
            offset_px = np.stack([column[few], row[few]], axis=1) - self.middle_px[frame]
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
        shape = sorted(self._shape_difference(frame, int(other)) for other in others)[1]
        return float(np.linalg.norm(in_plane_mm)) / median_radius_mm, wider_mm / median_radius_mm, shape

    def _shape_difference(self, frame: int, other: int) -> float:
        """The share of two masks that do not cover each other, once their middles and areas are the same (1 - DSC)."""
        scale = self.radius_mm[other] / self.radius_mm[frame]
        place = self.middle_px[other] + scale * self.drawn_mm[frame] / self.pixel_mm[other]
        column, row = np.rint(place).astype(np.int64).T
        height, width = self.filled.shape[1:]
        there = (column >= 0) & (row >= 0) & (column < width) & (row < height)
        # Pixels beyond the image border are unknown and do not count.
        if not there.any():
            return 1.0
        return 1 - float(self.filled[other][row[there], column[there]].mean())


def _line_at(
    path_mm: Float64[np.ndarray, " n"], values: Float64[np.ndarray, "n d"], place_mm: float
) -> Float64[np.ndarray, " d"]:
    """Values at a place by the line of median slope through others."""
    first, second = np.triu_indices(len(path_mm), 1)
    run_mm = path_mm[second] - path_mm[first]
    moving = run_mm > 1e-6
    if not moving.any():
        return np.asarray(np.median(values, axis=0))
    slope = np.median((values[second[moving]] - values[first[moving]]) / run_mm[moving, None], axis=0)
    return np.asarray(np.median(values + (place_mm - path_mm)[:, None] * slope, axis=0))
