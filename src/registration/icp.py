"""Iterative closest points, many starts in one vectorised step, with trimmed residuals.

Besl and McKay, IEEE PAMI 14(2), 1992 (the loop); Kabsch, Acta Cryst. A32, 1976 and Umeyama, IEEE PAMI 13(4), 1991
(the least-squares rotation); Chen and Medioni, Image Vision Comput. 10(3), 1992 (point to plane); Chetverikov et al.,
ICPR 2002 (trimming by a fixed share).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from registration import frames
from registration.errors import InputError

# A residual below this share of the cloud's radius is rounding: two equal clouds have met.
FLOOR_SHARE = 1e-10
# Directions of motion whose stiffness is below this share of the stiffest are left alone by a point-to-plane step.
STIFFNESS_SHARE = 1e-6
# Normals are estimated for so many points at a time, which bounds the memory for large clouds.
NORMALS_BLOCK = 50_000


@runtime_checkable
class Target(Protocol):
    """The fixed cloud, prepared for the question which of its points is closest."""

    points_mm: np.ndarray
    normals: np.ndarray | None

    def closest(self, points_mm: Float64[np.ndarray, "m 3"]) -> Int64[np.ndarray, "m"]:
        """Index into ``points_mm`` of the fixed point closest to each of the given ones."""
        ...


class TreeTarget:
    """Exact closest points by a k-d tree; ``neighbours`` above 0 also estimates a normal for every fixed point.

    Points that occur several times are kept once: they say nothing about the surface around them.
    """

    def __init__(self, points_mm: Float64[np.ndarray, "n 3"], neighbours: int = 0) -> None:
        self.points_mm: np.ndarray = np.unique(points_mm, axis=0)
        self._tree = cKDTree(self.points_mm)
        self.normals: np.ndarray | None = None
        if neighbours:
            blocks = np.array_split(self.points_mm, -(-len(self.points_mm) // NORMALS_BLOCK))
            self.normals = np.concatenate([self._normals(block, neighbours) for block in blocks])

    def _normals(self, points_mm: np.ndarray, neighbours: int) -> np.ndarray:
        """The direction in which the nearest points spread least; its sign does not matter to a squared residual."""
        index = np.asarray(self._tree.query(points_mm, k=min(neighbours, len(self.points_mm)))[1])
        patches_mm = self.points_mm[index]
        patches_mm = patches_mm - patches_mm.mean(axis=1, keepdims=True)
        return np.linalg.eigh(np.swapaxes(patches_mm, 1, 2) @ patches_mm)[1][:, :, 0]

    def closest(self, points_mm: Float64[np.ndarray, "m 3"]) -> Int64[np.ndarray, "m"]:
        """Index of the closest fixed point."""
        return np.asarray(self._tree.query(points_mm)[1], dtype=np.int64)

    @property
    def spacing_mm(self) -> float:
        """Median distance from a fixed point to its nearest neighbour."""
        distances_mm = np.asarray(self._tree.query(self.points_mm, k=2)[0])
        return float(np.median(distances_mm[:, 1]))


class VoxelTarget:
    """Closest points looked up in a table over a voxel grid: wrong by up to a voxel's diagonal, and far faster.

    The fixed points are averaged within each voxel; the table holds for every voxel the average nearest to it (exact
    Euclidean feature transform). Points outside the grid are answered by its border. ``cells`` is the number of
    voxels along the longest side of the cloud, ``margin`` the share of that side added around it.
    """

    def __init__(self, points_mm: Float64[np.ndarray, "n 3"], cells: int, margin: float = 0.25) -> None:
        extent_mm = np.ptp(points_mm, axis=0)
        self._step_mm = float(extent_mm.max()) / cells
        pad_mm = margin * float(extent_mm.max())
        self._origin_mm = points_mm.min(axis=0) - pad_mm
        self._shape = np.ceil((extent_mm + 2 * pad_mm) / self._step_mm).astype(np.int64) + 1
        flat = self._flat(points_mm)
        occupied, owner, count = np.unique(flat, return_inverse=True, return_counts=True)
        sums = np.stack([np.bincount(owner, points_mm[:, axis]) for axis in range(3)], axis=1)
        self.points_mm: np.ndarray = sums / count[:, None]
        self.normals: np.ndarray | None = None
        grid = np.full(int(self._shape.prod()), -1, dtype=np.int64)
        grid[occupied] = np.arange(len(occupied))
        grid = grid.reshape(self._shape)
        nearest = distance_transform_edt(grid < 0, return_distances=False, return_indices=True)
        self._table = grid[tuple(nearest)].ravel()

    def _flat(self, points_mm: np.ndarray) -> np.ndarray:
        cell = ((points_mm - self._origin_mm) / self._step_mm).astype(np.int64)
        np.clip(cell, 0, self._shape - 1, out=cell)
        return (cell[:, 0] * self._shape[1] + cell[:, 1]) * self._shape[2] + cell[:, 2]

    def closest(self, points_mm: Float64[np.ndarray, "m 3"]) -> Int64[np.ndarray, "m"]:
        """Index of the averaged fixed point that is nearest to the voxel each point lies in."""
        return self._table[self._flat(points_mm)]


def kabsch(
    moving_mm: Float64[np.ndarray, "*s n 3"],
    fixed_mm: Float64[np.ndarray, "*s n 3"],
    weights: Float64[np.ndarray, "*s n"],
) -> Float64[np.ndarray, "*s 4 4"]:
    """The rigid transforms that bring paired points closest in weighted least squares, never a mirrored one."""
    share = (weights / weights.sum(axis=-1, keepdims=True))[..., None]
    moving_centre_mm = (share * moving_mm).sum(axis=-2)
    fixed_centre_mm = (share * fixed_mm).sum(axis=-2)
    covariance = np.swapaxes(share * (moving_mm - moving_centre_mm[..., None, :]), -1, -2) @ (
        fixed_mm - fixed_centre_mm[..., None, :]
    )
    left, _, right = np.linalg.svd(covariance)
    left[..., :, 2] *= np.sign(np.linalg.det(left) * np.linalg.det(right))[..., None]
    rotation = np.swapaxes(left @ right, -1, -2)
    fixed_T_moving = np.zeros((*rotation.shape[:-2], 4, 4))
    fixed_T_moving[..., :3, :3] = rotation
    fixed_T_moving[..., :3, 3] = fixed_centre_mm - (rotation @ moving_centre_mm[..., None])[..., 0]
    fixed_T_moving[..., 3, 3] = 1.0
    return fixed_T_moving


@dataclass(frozen=True)
class Alignments:
    """Where ICP took each of s starts: poses, trimmed residuals in mm, steps taken, and whether it settled."""

    fixed_T_moving: Float64[np.ndarray, "s 4 4"]
    rmse_mm: Float64[np.ndarray, "s"]
    iterations: Int64[np.ndarray, "s"]
    converged: Bool[np.ndarray, "s"]


def point_step(
    moved_mm: Float64[np.ndarray, "s n 3"],
    target: Target,
    index: Int64[np.ndarray, "s n"],
    weights: Float64[np.ndarray, "s n"],
) -> Float64[np.ndarray, "s 4 4"]:
    """One point-to-point step: the least-squares rigid motion onto the paired points."""
    return kabsch(moved_mm, target.points_mm[index], weights)


def plane_step(
    moved_mm: Float64[np.ndarray, "s n 3"],
    target: Target,
    index: Int64[np.ndarray, "s n"],
    weights: Float64[np.ndarray, "s n"],
) -> Float64[np.ndarray, "s 4 4"]:
    """One point-to-plane step, linearised in the rotation; a direction the normals leave free is not moved along."""
    if target.normals is None:
        raise InputError("target: expected normals for a point-to-plane step, received none")
    centre_mm = moved_mm.mean(axis=1, keepdims=True)
    normals = target.normals[index]
    arm_mm = moved_mm - centre_mm
    # Angles are scaled by the cloud's radius so that all six unknowns are lengths and one cut-off serves them.
    radius_mm = np.sqrt((arm_mm**2).sum(axis=2).mean(axis=1))[:, None, None]
    jacobian = np.concatenate([np.cross(arm_mm, normals) / radius_mm, normals], axis=2)
    gap_mm = ((target.points_mm[index] - moved_mm) * normals).sum(axis=2)
    weighted = np.swapaxes(jacobian * weights[..., None], 1, 2)
    motion = np.linalg.pinv(weighted @ jacobian, rcond=STIFFNESS_SHARE, hermitian=True) @ (
        weighted @ gap_mm[..., None]
    )
    turn = Rotation.from_rotvec(motion[:, :3, 0] / radius_mm[:, 0])
    centre_mm = centre_mm[:, 0]
    return frames.from_rotation(turn, centre_mm + motion[:, 3:, 0] - turn.apply(centre_mm))


def trimming_weights(squared: Float64[np.ndarray, "s n"], keep: float) -> Float64[np.ndarray, "s n"]:
    """1 for the closest ``keep`` share of each row, 0 for the others."""
    if keep >= 1:
        return np.ones_like(squared)
    last = max(int(np.ceil(keep * squared.shape[1])), 3) - 1
    return (squared <= np.partition(squared, last, axis=1)[:, last, None]).astype(np.float64)


def align(
    moving_mm: Float64[np.ndarray, "n 3"],
    target: Target,
    starts: Float64[np.ndarray, "s 4 4"],
    *,
    keep: float,
    max_iterations: int,
    tolerance: float,
) -> Alignments:
    """Run ICP from every start at once.

    In each step every moving point is paired with its closest fixed point, the ``keep`` share with the smallest
    distances counts, and the cloud moves: along the normals if the target has them, else onto the paired points. A
    start has converged once its trimmed residual (along the normals, or to the points) comes within ``tolerance`` of
    itself one or two steps before: trimming can end in two poses that change places forever. It then rests while the
    others go on. The residual returned is that of the pose returned.
    """
    poses = np.array(starts, dtype=np.float64)
    count = len(poses)
    history_mm = np.full((2, count), np.inf)
    iterations, converged = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=bool)
    floor_mm = FLOOR_SHARE * float(np.sqrt(moving_mm.var(axis=0).sum()))
    step = point_step if target.normals is None else plane_step
    for iteration in range(max_iterations + 1):
        active = np.flatnonzero(~converged)
        moved_mm = moving_mm @ np.swapaxes(poses[active, :3, :3], 1, 2) + poses[active, None, :3, 3]
        index = target.closest(moved_mm.reshape(-1, 3)).reshape(moved_mm.shape[:2])
        offset_mm = target.points_mm[index] - moved_mm
        squared = (offset_mm**2).sum(axis=2)
        weights = trimming_weights(squared, keep)
        if target.normals is not None:
            squared = (offset_mm * target.normals[index]).sum(axis=2) ** 2
        rmse_mm = np.sqrt((weights * squared).sum(axis=1) / weights.sum(axis=1))
        change_mm = np.abs(history_mm[:, active] - rmse_mm).min(axis=0)
        settled = change_mm <= np.maximum(tolerance * rmse_mm, floor_mm)
        converged[active] = settled
        history_mm[:, active] = np.stack([rmse_mm, history_mm[0, active]])
        if iteration == max_iterations or settled.all():
            break
        on = active[~settled]
        poses[on] = step(moved_mm[~settled], target, index[~settled], weights[~settled]) @ poses[on]
        iterations[on] += 1
    return Alignments(poses, history_mm[0], iterations, converged)
