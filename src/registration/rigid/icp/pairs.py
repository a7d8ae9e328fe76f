"""Pairs of moving and fixed points, for many poses at once, which the steps of ICP pass on."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float64

from registration.rigid.icp.correspondence import Target


@dataclass(frozen=True)
class Pairs:
    """Moved points and the fixed points closest to them, for each of s poses, in the fixed frame.

    The signs of normals are arbitrary.

    Parameters
    ----------
    moved_mm : ndarray, shape (s, n, 3)
        Moved points in mm.
    fixed_mm : ndarray, shape (s, n, 3)
        Fixed points closest to them in mm.
    normals : ndarray, shape (s, n, 3) or None, optional
        Unit normals of the fixed points; None where none were estimated.
    moved_normals : ndarray, shape (s, n, 3) or None, optional
        Unit normals of the moved points, rotated with them; None where none were estimated.
    """

    moved_mm: Float64[np.ndarray, "s n 3"]
    fixed_mm: Float64[np.ndarray, "s n 3"]
    normals: Float64[np.ndarray, "s n 3"] | None = None
    moved_normals: Float64[np.ndarray, "s n 3"] | None = None

    @cached_property
    def offset_mm(self) -> Float64[np.ndarray, "s n 3"]:
        """Vector from the moved point to its fixed one in mm."""
        return self.fixed_mm - self.moved_mm

    @cached_property
    def squared_mm2(self) -> Float64[np.ndarray, "s n"]:
        """Squared distance of each pair in mm2."""
        return np.einsum("snk,snk->sn", self.offset_mm, self.offset_mm)

    @cached_property
    def gap_mm(self) -> Float64[np.ndarray, "s n"]:
        """Signed distance along the fixed point's normal in mm; the full distance without normals."""
        if self.normals is None:
            return np.sqrt(self.squared_mm2)
        return np.einsum("snk,snk->sn", self.offset_mm, self.normals)

    @cached_property
    def aside_mm2(self) -> Float64[np.ndarray, "s n"]:
        """Squared distance across the fixed point's normal in mm2; 0 without normals."""
        return np.maximum(self.squared_mm2 - self.gap_mm**2, 0.0)


def closest_pairs(
    moving_mm: Float64[np.ndarray, "n 3"],
    target: Target,
    poses: Float64[np.ndarray, "s 4 4"],
    moving_normals: Float64[np.ndarray, "n 3"] | None = None,
) -> Pairs:
    """Move the points by each pose and pair them with the closest fixed points.

    Parameters
    ----------
    moving_mm : ndarray, shape (n, 3)
        Moving points in mm.
    target : Target
        Fixed cloud.
    poses : ndarray, shape (s, 4, 4)
        Poses (fixed_T_moving).
    moving_normals : ndarray, shape (n, 3) or None, optional
        Unit normals of the moving points; None for none.

    Returns
    -------
    Pairs
        The pairs of every pose.
    """
    turned = np.swapaxes(poses[:, :3, :3], 1, 2)
    moved_mm = moving_mm @ turned + poses[:, None, :3, 3]
    index = target.closest(moved_mm.reshape(-1, 3)).reshape(moved_mm.shape[:2])
    return Pairs(
        moved_mm,
        target.points_mm[index],
        None if target.normals is None else target.normals[index],
        None if moving_normals is None else moving_normals @ turned,
    )
