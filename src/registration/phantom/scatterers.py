"""Scatterers fixed in the tissue in three dimensions: one at a random place in every cell of a lattice."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Float64, Int64, UInt32

from registration.phantom.lattice_noise import hash_cells, mix


@dataclass(frozen=True)
class Slab:
    """Block of tissue around the image plane, in the tissue's frame.

    Parameters
    ----------
    tissue_T_image : ndarray, shape (4, 4)
        Rigid transform from (lateral, depth, elevation) in mm to the tissue.
    low_mm, high_mm : ndarray, shape (3,)
        Lower and upper corner of the block in these coordinates, in mm.
    """

    tissue_T_image: Float64[np.ndarray, "4 4"]
    low_mm: Float64[np.ndarray, "3"]
    high_mm: Float64[np.ndarray, "3"]

    @property
    def corners_mm(self) -> Float64[np.ndarray, "8 3"]:
        """Corners of the block in the tissue's frame in mm."""
        choices = np.stack(np.meshgrid(*zip(self.low_mm, self.high_mm, strict=True), indexing="ij"), axis=-1)
        return choices.reshape(-1, 3) @ self.tissue_T_image[:3, :3].T + self.tissue_T_image[:3, 3]


def cells_in(slab: Slab, pitch_mm: float) -> Int64[np.ndarray, "n 3"]:
    """Find the lattice cells that touch the block, and some around it.

    The lattice is walked column by column along the axis that is closest to the plane's normal, so the number
    of cells visited is proportional to the block, whatever its direction.

    Parameters
    ----------
    slab : Slab
        Block of tissue.
    pitch_mm : float
        Side of a lattice cell in mm.

    Returns
    -------
    ndarray of int, shape (n, 3)
        Lattice indices of the cells.
    """
    rotation, origin_mm = slab.tissue_T_image[:3, :3], slab.tissue_T_image[:3, 3]
    normal = rotation[:, 2]
    main = int(np.abs(normal).argmax())
    first, second = [axis for axis in range(3) if axis != main]
    corners_mm = slab.corners_mm
    spans = [
        np.arange(
            np.floor(corners_mm[:, axis].min() / pitch_mm), np.ceil(corners_mm[:, axis].max() / pitch_mm)
        )
        for axis in (first, second)
    ]
    i, j = (grid.ravel() for grid in np.meshgrid(*spans, indexing="ij"))
    lean = (
        normal[first] * ((i + 0.5) * pitch_mm - origin_mm[first])
        + normal[second] * ((j + 0.5) * pitch_mm - origin_mm[second])
    ) / normal[main]
    slack_mm = pitch_mm * 0.5 * (abs(normal[first]) + abs(normal[second])) / abs(normal[main])
    ends_mm = np.sort(np.array([slab.low_mm[2], slab.high_mm[2]]) / normal[main])
    bottom = np.floor((origin_mm[main] - lean + ends_mm[0] - slack_mm) / pitch_mm)
    count = int(np.ceil((ends_mm[1] - ends_mm[0] + 2 * slack_mm) / pitch_mm)) + 1
    keep = _columns_inside(slab, (first, second, main), (i, j, bottom + 0.5 * count), pitch_mm, count)
    cells = np.empty((int(keep.sum()), count, 3), dtype=np.int64)
    cells[..., first], cells[..., second] = i[keep, None], j[keep, None]
    cells[..., main] = bottom[keep, None] + np.arange(count)
    return cells.reshape(-1, 3)


def place(
    cells: Int64[np.ndarray, "n 3"], pitch_mm: float, seed: int
) -> tuple[Float32[np.ndarray, "n 3"], Float32[np.ndarray, " n"], UInt32[np.ndarray, " n"]]:
    """Place one scatterer in each lattice cell.

    Parameters
    ----------
    cells : ndarray of int, shape (n, 3)
        Lattice indices of the cells.
    pitch_mm : float
        Side of a lattice cell in mm.
    seed : int
        Seed of the tissue.

    Returns
    -------
    positions_mm : ndarray of float32, shape (n, 3)
        Positions in mm.
    strength : ndarray of float32, shape (n,)
        Strength, of either sign, zero mean and 1 RMS.
    bits : ndarray of uint32, shape (n,)
        32 random bits of each scatterer.
    """
    bits = hash_cells(cells[:, 0], cells[:, 1], cells[:, 2], seed)
    more = mix(bits ^ np.uint32(0x68E31DA4))
    positions_mm = np.empty((len(cells), 3), dtype=np.float32)
    for axis in range(3):
        within = ((bits >> np.uint32(10 * axis)) & np.uint32(1023)).astype(np.float32)
        positions_mm[:, axis] = (cells[:, axis] + (within + 0.5) / 1024.0) * pitch_mm
    # Strengths of nearly one size make the most of few scatterers; 49/48 is the mean square before scaling.
    signed = more.view(np.int32).astype(np.float32) / np.float32(2**31)
    strength = (0.5 * signed + np.copysign(np.float32(0.75), signed)) / np.float32(np.sqrt(49 / 48))
    return positions_mm, strength, more


def _columns_inside(
    slab: Slab,
    axes: tuple[int, int, int],
    indices: tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"], Float[np.ndarray, " m"]],
    pitch_mm: float,
    count: int,
) -> np.ndarray:
    """Whether a column's middle lies within the block's lateral and depth range, with room for its whole length."""
    middle_mm = np.empty((len(indices[0]), 3))
    for axis, index in zip(axes, indices, strict=True):
        middle_mm[:, axis] = (index + 0.5) * pitch_mm
    local_mm = (middle_mm - slab.tissue_T_image[:3, 3]) @ slab.tissue_T_image[:3, :3]
    reach_mm = pitch_mm + 0.5 * count * pitch_mm * np.abs(slab.tissue_T_image[axes[2], :2])
    inside = (local_mm[:, :2] > slab.low_mm[:2] - reach_mm) & (local_mm[:, :2] < slab.high_mm[:2] + reach_mm)
    return np.asarray(inside.all(axis=1))
