"""Vessel contours of tracked masks, below a pixel, as points in the world with outward normals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, Float64, Int64
from scipy.ndimage import gaussian_filter, map_coordinates

from registration import transforms
from registration.brief import brief_repr
from registration.errors import InputError
from registration.geometry.point_cloud import OrientedCloud
from registration.reconstruction.mask_series import box_of

# Distance in px from a contour, on both sides, at which the probability is read for its confidence.
CONFIDENCE_REACH_PX = 2.0

Mask = Bool[np.ndarray, "height width"] | Float[np.ndarray, "height width"]
Masks = Bool[np.ndarray, "k height width"] | Float[np.ndarray, "k height width"] | Sequence[Mask]


@dataclass(frozen=True)
class ContourCloud(OrientedCloud):
    """Contour points of all masks of a sweep, in world coordinates.

    ``points_mm`` (p, 3) are in mm; ``normals`` (p, 3) of unit length lie in each image's plane and point out
    of the vessel.

    Parameters
    ----------
    frame_index : ndarray of int, shape (p,)
        Mask that each point comes from.
    contour_index : ndarray of int, shape (p,)
        Contour that each point comes from, numbered through all masks.
    is_open : ndarray of bool, shape (p,)
        Points of contours that are cut by the image border.
    confidence : ndarray, shape (p,)
        Fall of the probability across the contour within two pixels on both sides, 0 to 1; 1 for binary
        masks.
    world_A_pixel : ndarray, shape (m, 4, 4)
        Affine matrices from pixels to world mm of all masks, including those without a vessel.
    """

    frame_index: Int64[np.ndarray, " p"]
    contour_index: Int64[np.ndarray, " p"]
    is_open: Bool[np.ndarray, " p"]
    confidence: Float64[np.ndarray, " p"]
    world_A_pixel: Float64[np.ndarray, "m 4 4"] = field(metadata={"per_frame": True})

    __repr__ = brief_repr


@dataclass(frozen=True)
class ContourExtractor:
    """Vessel contours by marching squares on each mask.

    Parameters
    ----------
    level : float, optional
        Value of a probability map on the contour, between 0 and 1.
    smoothing_px : float, optional
        Standard deviation in px of the Gaussian that smooths a binary mask's staircase; probability maps are
        not smoothed. A circle of radius r px shrinks by about ``smoothing_px**2 / (2 r)``.
    min_points : int, optional
        Contours of fewer points are discarded; at least 3.

    Raises
    ------
    InputError
        If a value is out of range.

    References
    ----------
    W. E. Lorensen and H. E. Cline, SIGGRAPH 1987 (in two dimensions).
    """

    level: float = 0.5
    smoothing_px: float = 1.0
    min_points: int = 8

    def __post_init__(self) -> None:
        if not 0 < self.level < 1:
            raise InputError(f"level: expected a value between 0 and 1, received {self.level}")
        if not self.smoothing_px >= 0:
            raise InputError(f"smoothing_px: expected 0 or more pixels, received {self.smoothing_px}")
        if self.min_points < 3:
            raise InputError(f"min_points: expected at least 3, received {self.min_points}")

    def __call__(
        self,
        masks: Masks,
        world_A_pixel: Float64[np.ndarray, "m 4 4"],
    ) -> ContourCloud:
        """Extract the contours of all masks and map them to the world.

        Parameters
        ----------
        masks : ndarray of bool or float, shape (k, height, width), or sequence of k arrays (height, width)
            Masks or probability maps; each may show any number of vessels, or none.
        world_A_pixel : ndarray, shape (k, 4, 4)
            Affine matrix of each mask from ``(column, row, 0, 1)`` in px to world mm.

        Returns
        -------
        ContourCloud
            All contour points; empty without any vessel. A contour that leaves the image stays open: its
            points on the image border are dropped.

        Raises
        ------
        InputError
            If masks and matrices differ in number, or a matrix is not affine.
        """
        if len(masks) != len(world_A_pixel):
            raise InputError(
                f"world_A_pixel: expected one transform for each of {len(masks)} masks, received {len(world_A_pixel)}"
            )
        transforms.require_affine(world_A_pixel, "world_A_pixel")
        lines = [(index, line) for index, mask in enumerate(masks) for line in self.contours_px(mask)]
        # A closed contour repeats its first point; in a cloud that would count twice.
        own = [line[:-1] if _closed(line) else line for _, line in lines]
        sizes = [len(points) for points in own]
        points_px = np.concatenate([np.empty((0, 2)), *own])
        tangents_px = np.concatenate([np.empty((0, 2)), *(_tangents(line) for _, line in lines)])
        index = np.repeat(np.array([which for which, _ in lines], dtype=np.int64), sizes)
        is_open = np.repeat(np.array([not _closed(line) for _, line in lines], dtype=bool), sizes)
        inner = ~_on_border(points_px, index, np.array([mask.shape[::-1] for mask in masks]).reshape(-1, 2))
        points_px, tangents_px, index = points_px[inner], tangents_px[inner], index[inner]
        return ContourCloud(
            points_mm=transforms.apply_each(world_A_pixel[index], np.pad(points_px, ((0, 0), (0, 1)))),
            normals=_normals(tangents_px, world_A_pixel[index]),
            frame_index=index,
            contour_index=np.repeat(np.arange(len(lines), dtype=np.int64), sizes)[inner],
            is_open=is_open[inner],
            confidence=_confidence(masks, points_px, tangents_px, index),
            world_A_pixel=world_A_pixel,
        )

    def contours_px(
        self, mask: Bool[np.ndarray, "height width"] | Float[np.ndarray, "height width"]
    ) -> list[Float64[np.ndarray, "p 2"]]:
        """Extract the contours of one mask in pixels.

        Parameters
        ----------
        mask : ndarray of bool or float, shape (height, width)
            Mask or probability map.

        Returns
        -------
        list of ndarray, shape (p, 2)
            Points as (column, row) in px; closed contours repeat the first point at the end. Seen in the
            image (rows downwards), the vessel lies on the right of the direction of travel.
        """
        from skimage.measure import find_contours

        # Smoothing the crop alone is exact: beyond four deviations the mask is constant.
        filled = mask if mask.dtype == np.bool_ else mask >= self.level
        box = box_of(filled, int(np.ceil(4 * self.smoothing_px)) + 2)
        if not filled[box].size:
            return []
        values = mask[box].astype(np.float64)
        if mask.dtype == np.bool_ and self.smoothing_px > 0:
            values = gaussian_filter(values, self.smoothing_px, mode="nearest")
        found = find_contours(values, self.level, positive_orientation="low")
        corner = np.array([box[1].start, box[0].start], dtype=np.float64)
        return [line[:, ::-1] + corner for line in found if len(line) >= self.min_points]


def _tangents(line: Float64[np.ndarray, "p 2"]) -> Float64[np.ndarray, "q 2"]:
    """Direction of travel at each point, from the second point before to the second after it.

    Marching squares sets points at uneven distances, some of them tiny: differences of direct neighbours would turn
    with the pixel grid. Near the ends of an open contour fewer points count. The repeated last point of a closed
    contour has no tangent of its own.
    """
    if _closed(line):
        return np.roll(line[:-1], -2, axis=0) - np.roll(line[:-1], 2, axis=0)
    own = np.arange(len(line))
    return line[np.minimum(own + 2, len(line) - 1)] - line[np.maximum(own - 2, 0)]


def _closed(line: Float64[np.ndarray, "p 2"]) -> bool:
    return np.array_equal(line[0], line[-1])


def _on_border(
    points_px: Float64[np.ndarray, "p 2"], index: Int64[np.ndarray, " p"], sizes_px: Int64[np.ndarray, "k 2"]
) -> Bool[np.ndarray, " p"]:
    """Which points lie on the border of their image; sizes are (width, height)."""
    return np.asarray(((points_px <= 0) | (points_px >= sizes_px[index] - 1)).any(axis=1))


def _normals(
    tangents_px: Float64[np.ndarray, "p 2"], world_A_pixel: Float64[np.ndarray, "p 4 4"]
) -> Float64[np.ndarray, "p 3"]:
    """Unit vectors in the image plane, at right angles to the tangent in millimetres, away from the vessel.

    The tangent is mapped first and turned after, because pixel axes need be neither equal nor orthogonal. Columns
    times rows gives the side of the plane that the turn is seen from, so mirrored axes need no special case.
    """
    along = np.einsum("pij,pj->pi", world_A_pixel[:, :3, :2], tangents_px)
    facing = np.cross(world_A_pixel[:, :3, 0], world_A_pixel[:, :3, 1])
    outwards = np.cross(along, facing)
    length = np.linalg.norm(outwards, axis=1, keepdims=True)
    return outwards / np.maximum(length, np.finfo(np.float64).tiny)


def _confidence(
    masks: Masks,
    points_px: Float64[np.ndarray, "p 2"],
    tangents_px: Float64[np.ndarray, "p 2"],
    index: Int64[np.ndarray, " p"],
) -> Float64[np.ndarray, " p"]:
    """How much the probability falls from the vessel's side of each point to the other; 1 for binary masks.

    The vessel lies on the right of the direction of travel, seen with rows downwards.
    """
    if not len(masks) or masks[0].dtype == np.bool_:
        return np.ones(len(points_px))
    length = np.maximum(np.linalg.norm(tangents_px, axis=1, keepdims=True), np.finfo(np.float64).tiny)
    inwards_px = CONFIDENCE_REACH_PX * np.stack([-tangents_px[:, 1], tangents_px[:, 0]], axis=1) / length
    fall = np.zeros(len(points_px))
    # The points come in the order of the frames.
    frames, begins = np.unique(index, return_index=True)
    ends = np.append(begins[1:], len(index))
    for frame, begin, end in zip(frames, begins, ends[: len(frames)], strict=True):
        own = slice(begin, end)
        sides = [
            map_coordinates(
                masks[frame], (points_px[own] + side * inwards_px[own]).T[::-1], order=1, mode="nearest"
            )
            for side in (1, -1)
        ]
        fall[own] = sides[0] - sides[1]
    return np.clip(fall, 0.0, 1.0)
