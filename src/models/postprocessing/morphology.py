"""Morphology of masks: closing, hole filling and removal of small components."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from models.array_types import Bool
from models.errors import InputError
from models.postprocessing.components import Components, bounding_box, components, require_connectivity

# Relative differences of lengths and areas below this are rounding.
ROUNDING = 1e-9


@dataclass(frozen=True)
class Morphology:
    """Closing, hole filling, removal of small components and of all but the largest, in this order.

    Sizes in mm apply where an image's spacing is known, those in px where it is not, or where none in mm is
    given.

    Parameters
    ----------
    closing_radius_px, closing_radius_mm : float or None, optional
        Radius of the disc of a morphological closing; None or 0 for no closing.
    fill_holes : bool, optional
        Whether background that is enclosed by vessel becomes vessel.
    min_area_px, min_area_mm2 : float or None, optional
        Components of smaller area are removed; None or 0 keeps all.
    largest_only : bool, optional
        Whether only the largest component is kept, the first in the image of several.
    connectivity : int, optional
        Connectivity of the vessel, as in ``Hysteresis``; the background has the other one, so that a closed
        curve always separates its inside from its outside.

    Raises
    ------
    InputError
        If a parameter is out of range.

    References
    ----------
    J. Serra, 1982 (closing); A. Rosenfeld, 1970 (connectivity).
    """

    closing_radius_px: float | None = None
    closing_radius_mm: float | None = None
    fill_holes: bool = False
    min_area_px: float | None = None
    min_area_mm2: float | None = None
    largest_only: bool = False
    connectivity: int = 1

    def __post_init__(self) -> None:
        for name in ("closing_radius_px", "closing_radius_mm", "min_area_px", "min_area_mm2"):
            size = getattr(self, name)
            if size is not None and not 0 <= size < math.inf:
                raise InputError(f"{name}: expected a number from 0, received {size}")
        require_connectivity(self.connectivity)

    def __call__(
        self, mask: Bool[np.ndarray, "h w"], spacing_mm: tuple[float, float] | None
    ) -> Bool[np.ndarray, "h w"]:
        """Process the mask of one image.

        Parameters
        ----------
        mask : ndarray of bool, shape (h, w)
            Mask of the vessel.
        spacing_mm : tuple of float or None
            Vertical and horizontal size of a pixel in mm; None where unknown.

        Returns
        -------
        ndarray of bool, shape (h, w)
            The processed mask.

        Raises
        ------
        InputError
            If the spacing is needed and unknown, or is not positive.
        """
        if spacing_mm is not None and not all(0 < side < math.inf for side in spacing_mm):
            raise InputError(f"spacing_mm: expected two positive numbers, received {spacing_mm}")
        radius, unit = self._size("closing_radius", "mm", spacing_mm)
        min_area, _ = self._size("min_area", "mm2", spacing_mm)
        area_unit = self._pixel_area(spacing_mm)
        if radius:
            mask = closed(mask, radius, unit)
        if self.fill_holes:
            mask = filled(mask, self.connectivity)
        if not (min_area or self.largest_only) or not mask.any():
            return mask.copy()
        found = components(mask, self.connectivity)
        areas = found.areas * area_unit
        areas[0] = 0
        kept = areas >= max(min_area, ROUNDING) * (1 - ROUNDING)
        if self.largest_only:
            kept &= np.arange(len(areas)) == int(np.argmax(areas))
        return _selected(found, kept, mask.shape)

    def _size(
        self, name: str, unit: str, spacing_mm: tuple[float, float] | None
    ) -> tuple[float, tuple[float, float]]:
        """A size that holds for an image, and the size of a pixel in its unit."""
        metric, pixels = getattr(self, f"{name}_{unit}"), getattr(self, f"{name}_px")
        if metric is None:
            return pixels or 0.0, (1.0, 1.0)
        if spacing_mm is not None:
            return metric, spacing_mm
        if pixels is None and metric:
            raise InputError(
                f"spacing_mm: expected the size of a pixel for {name}_{unit}={metric}, received none "
                f"(give {name}_px for images of unknown spacing)"
            )
        return pixels or 0.0, (1.0, 1.0)

    def _pixel_area(self, spacing_mm: tuple[float, float] | None) -> float:
        return 1.0 if spacing_mm is None or self.min_area_mm2 is None else spacing_mm[0] * spacing_mm[1]


def closed(
    mask: Bool[np.ndarray, "h w"], radius: float, spacing: tuple[float, float]
) -> Bool[np.ndarray, "h w"]:
    """Close a mask by a disc: background stays where a disc that holds it fits outside the mask.

    Beyond the image border is background, and discs may lie there.

    Parameters
    ----------
    mask : ndarray of bool, shape (h, w)
        Mask.
    radius : float
        Radius of the disc, in the unit of ``spacing``.
    spacing : tuple of float
        Vertical and horizontal distance of pixel centres.

    Returns
    -------
    ndarray of bool, shape (h, w)
        The closed mask.
    """
    rows, columns = bounding_box(mask)
    if rows.stop == 0:
        return mask.copy()
    reach = radius * (1 + ROUNDING)
    margins = [math.ceil(reach / side) + 1 for side in spacing]
    padded = np.pad(mask[rows, columns], [(margin, margin) for margin in margins])
    eroded = ~_dilated(~_dilated(padded, reach, spacing), reach, spacing)
    result = np.zeros(mask.shape, dtype=bool)
    result[rows, columns] = eroded[margins[0] : -margins[0], margins[1] : -margins[1]]
    return result


def _dilated(
    mask: Bool[np.ndarray, "h w"], reach: float, spacing: tuple[float, float]
) -> Bool[np.ndarray, "h w"]:
    """Pixels no farther than ``reach`` from the mask: a disc is a stack of rows, and a row a difference of sums.

    For a disc of a few rows this is several times faster than a distance transform.
    """
    height, width = mask.shape
    side = min(math.floor(reach / spacing[1]), width)
    sums = np.zeros((height, width + 2 * side + 1), dtype=np.int32)
    np.cumsum(mask, axis=1, out=sums[:, side + 1 : side + 1 + width])
    sums[:, side + 1 + width :] = sums[:, side + width, None]
    result = np.zeros(mask.shape, dtype=bool)
    for row in range(min(math.floor(reach / spacing[0]), height - 1) + 1):
        half = min(math.floor(math.sqrt(max(reach**2 - (row * spacing[0]) ** 2, 0)) / spacing[1]), side)
        near = sums[:, side + half + 1 : side + half + 1 + width] > sums[:, side - half : side - half + width]
        result[row:] |= near[: height - row]
        result[: height - row] |= near[row:]
    return result


def filled(mask: Bool[np.ndarray, "h w"], connectivity: int) -> Bool[np.ndarray, "h w"]:
    """Fill the holes of a mask: background from which no path leads beyond the image.

    Parameters
    ----------
    mask : ndarray of bool, shape (h, w)
        Mask.
    connectivity : int
        Connectivity of the mask; the background has the other one.

    Returns
    -------
    ndarray of bool, shape (h, w)
        The mask without holes.
    """
    box = bounding_box(mask)
    framed = np.pad(mask[box], 1)
    background = ndimage.generate_binary_structure(2, 3 - connectivity)
    labels, _ = ndimage.label(~framed, structure=background)
    result = mask.copy()
    # The padding is one component of the background: all that is open is connected with it.
    result[box] = (labels != labels[0, 0])[1:-1, 1:-1]
    return result


def _selected(
    found: Components, kept: Bool[np.ndarray, " n"], shape: tuple[int, ...]
) -> Bool[np.ndarray, "h w"]:
    result = np.zeros(shape, dtype=bool)
    result[found.box] = kept[found.labels]
    return result
