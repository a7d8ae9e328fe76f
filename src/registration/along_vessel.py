"""Positions along a vessel's principal axis: the ruler by which it is cut into pieces and into frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from registration.checks import require_count
from registration.errors import InputError
from registration.geometry import Mesh, surface_frame
from registration.metrics import Surface


@dataclass(frozen=True)
class AlongVessel:
    """A surface's principal axis as a ruler: ``axis`` (3,), and where the surface begins and ends on it, in mm."""

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
        """The ruler of a mesh (its vertices in use) or a cloud."""
        axis = surface_frame(surface).axes[:, 0]
        whole_mm = surface.vertices_mm[np.unique(surface.triangles)] if isinstance(surface, Mesh) else surface
        position_mm = whole_mm @ axis
        return cls(axis, float(position_mm.min()), float(position_mm.max()))

    @property
    def length_mm(self) -> float:
        """From the beginning to the end."""
        return self.last_mm - self.first_mm

    def position_mm(self, points_mm: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n"]:
        """Where points lie on the ruler."""
        return points_mm @ self.axis

    def slab(self, points_mm: Float64[np.ndarray, "n 3"], count: int) -> Int64[np.ndarray, "n"]:
        """In which of ``count`` equal slabs across the vessel, from 0, points lie: the frames of a sweep along it."""
        require_count("count", count, 1)
        share = (self.position_mm(points_mm) - self.first_mm) / self.length_mm
        return np.clip(np.floor(share * count), 0, count - 1).astype(np.int64)
