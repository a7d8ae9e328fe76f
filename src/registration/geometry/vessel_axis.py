"""Positions along a vessel's principal axis, by which it is cut into pieces and into slabs like frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from registration.checks import require_count
from registration.errors import InputError
from registration.geometry.shapes import Mesh, Surface, surface_frame


@dataclass(frozen=True)
class AlongVessel:
    """Principal axis of a surface, with the surface's extent along it.

    Parameters
    ----------
    axis : ndarray, shape (3,)
        Unit vector of the axis.
    first_mm, last_mm : float
        Where the surface begins and ends along the axis in mm.

    Raises
    ------
    InputError
        If the surface has no extent.
    """

    axis: Float64[np.ndarray, "3"]
    first_mm: float
    last_mm: float

    def __post_init__(self) -> None:
        if not self.last_mm > self.first_mm:
            raise InputError(
                f"last_mm: expected above first_mm, {self.first_mm:g}, received {self.last_mm:g}"
            )

    @classmethod
    def of(cls, surface: Surface) -> AlongVessel:
        """Compute the axis and the extent of a surface.

        Parameters
        ----------
        surface : Surface
            Mesh, of which the vertices in use count, or points (n, 3) in mm.

        Returns
        -------
        AlongVessel
            Axis and extent.

        Raises
        ------
        InputError
            If the surface has no extent.
        """
        axis = surface_frame(surface).axes[:, 0]
        whole_mm = surface.vertices_mm[np.unique(surface.triangles)] if isinstance(surface, Mesh) else surface
        position_mm = whole_mm @ axis
        return cls(axis, float(position_mm.min()), float(position_mm.max()))

    @property
    def length_mm(self) -> float:
        """Extent along the axis in mm."""
        return self.last_mm - self.first_mm

    def position_mm(self, points_mm: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, " n"]:
        """Project points on the axis.

        Parameters
        ----------
        points_mm : ndarray, shape (n, 3)
            Points in mm.

        Returns
        -------
        ndarray, shape (n,)
            Positions along the axis in mm.
        """
        return points_mm @ self.axis

    def slab(self, points_mm: Float64[np.ndarray, "n 3"], count: int) -> Int64[np.ndarray, " n"]:
        """Assign points to equal slabs across the vessel: the frames of a sweep along it.

        Parameters
        ----------
        points_mm : ndarray, shape (n, 3)
            Points in mm.
        count : int
            Number of slabs, at least 1.

        Returns
        -------
        ndarray of int, shape (n,)
            Index of each point's slab, from 0; points beyond an end belong to the last slab there.

        Raises
        ------
        InputError
            If there is no slab.
        """
        require_count("count", count, 1)
        share = (self.position_mm(points_mm) - self.first_mm) / self.length_mm
        return np.clip(np.floor(share * count), 0, count - 1).astype(np.int64)
