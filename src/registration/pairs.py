"""Pairs of moving and fixed points, for many poses at once: what the steps of ICP hand to each other."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float64

from registration.correspondence import Target


@dataclass(frozen=True)
class Pairs:
    """Moved points and the fixed points closest to them, for each of s poses, in the fixed frame.

    ``normals`` are those of the fixed points, ``moved_normals`` those of the moved ones, turned with them; either is
    None where nobody estimated it. Their signs are arbitrary.
    """

    moved_mm: Float64[np.ndarray, "s n 3"]
    fixed_mm: Float64[np.ndarray, "s n 3"]
    normals: Float64[np.ndarray, "s n 3"] | None = None
    moved_normals: Float64[np.ndarray, "s n 3"] | None = None

    @cached_property
    def offset_mm(self) -> Float64[np.ndarray, "s n 3"]:
        """From the moved point to its fixed one."""
        return self.fixed_mm - self.moved_mm

    @cached_property
    def squared_mm2(self) -> Float64[np.ndarray, "s n"]:
        """The squared distance of each pair."""
        return np.einsum("snk,snk->sn", self.offset_mm, self.offset_mm)

    @cached_property
    def gap_mm(self) -> Float64[np.ndarray, "s n"]:
        """The distance along the fixed point's normal, signed as the normal is; all of it where there is none."""
        if self.normals is None:
            return np.sqrt(self.squared_mm2)
        return np.einsum("snk,snk->sn", self.offset_mm, self.normals)


def closest_pairs(
    moving_mm: Float64[np.ndarray, "n 3"],
    target: Target,
    poses: Float64[np.ndarray, "s 4 4"],
    moving_normals: Float64[np.ndarray, "n 3"] | None = None,
) -> Pairs:
    """Move the points by each pose (a fixed_T_moving) and pair them with the closest points of ``target``."""
    turned = np.swapaxes(poses[:, :3, :3], 1, 2)
    moved_mm = moving_mm @ turned + poses[:, None, :3, 3]
    index = target.closest(moved_mm.reshape(-1, 3)).reshape(moved_mm.shape[:2])
    return Pairs(
        moved_mm,
        target.points_mm[index],
        None if target.normals is None else target.normals[index],
        None if moving_normals is None else moving_normals @ turned,
    )
