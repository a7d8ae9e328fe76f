"""Correspondence: the fixed cloud prepared for closest-point queries, exactly or by a lookup table."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float64, Int64
from scipy.ndimage import distance_transform_edt

if TYPE_CHECKING:
    from small_gicp import KdTree

# Normals are estimated for so many points at a time, which bounds the memory for large clouds.
NORMALS_BLOCK = 50_000


@runtime_checkable
class Target(Protocol):
    """Fixed cloud: its points, their normals where known, and which of them is closest."""

    points_mm: np.ndarray
    normals: np.ndarray | None

    def closest(self, points_mm: Float64[np.ndarray, "m 3"]) -> Int64[np.ndarray, " m"]:
        """Find the closest fixed point of each point.

        Parameters
        ----------
        points_mm : ndarray, shape (m, 3)
            Points in mm.

        Returns
        -------
        ndarray of int, shape (m,)
            Indices of the fixed points.
        """
        ...


def search_tree(points_mm: Float64[np.ndarray, "n 3"]) -> KdTree:
    """Build a k-d tree with small_gicp, two to three times as fast here as SciPy's.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3)
        Points in mm.

    Returns
    -------
    small_gicp.KdTree
        The tree.

    References
    ----------
    K. Koide, JOSS 9(100), 2024.
    """
    from small_gicp import KdTree

    return KdTree(points_mm)


class TreeTarget:
    """Exact closest points by a k-d tree.

    Points that occur several times are kept once: they say nothing about the surface around them. The sign of
    a normal is arbitrary.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3)
        Fixed points in mm.
    neighbours : int, optional
        Number of neighbours from which a normal is estimated for every fixed point; 0 estimates none.
    around : int, optional
        Number of neighbours of every point that are remembered for later patches, unless the cloud is large.
    """

    def __init__(self, points_mm: Float64[np.ndarray, "n 3"], neighbours: int = 0, around: int = 0) -> None:
        self.points_mm: np.ndarray = np.unique(points_mm, axis=0)
        self._tree = search_tree(self.points_mm)
        self._around: tuple[np.ndarray, np.ndarray] | None = None
        if around and len(self.points_mm) <= NORMALS_BLOCK:
            self._around = self._nearest(self.points_mm, max(around, neighbours))
        self.normals: np.ndarray | None = self.normals_at(self.points_mm, neighbours) if neighbours else None

    def normals_at(
        self, points_mm: Float64[np.ndarray, "m 3"], neighbours: int
    ) -> Float64[np.ndarray, "m 3"]:
        """Estimate normals: the direction in which the fixed points nearest to each point spread least.

        Parameters
        ----------
        points_mm : ndarray, shape (m, 3)
            Points in mm.
        neighbours : int
            Number of fixed points around each.

        Returns
        -------
        ndarray, shape (m, 3)
            Unit normals of arbitrary sign.

        References
        ----------
        H. Hoppe et al., SIGGRAPH 1992.
        """
        count = -(-len(points_mm) // NORMALS_BLOCK)
        blocks = np.array_split(points_mm, count) if count > 1 else [points_mm]
        return np.concatenate(
            [principal_axes(self.patches(block, neighbours)[0])[:, :, 0] for block in blocks]
        )

    def patches(
        self, points_mm: Float64[np.ndarray, "m 3"], neighbours: int
    ) -> tuple[Float64[np.ndarray, "m k 3"], Float64[np.ndarray, "m k"]]:
        """Find the fixed points nearest to each point.

        Parameters
        ----------
        points_mm : ndarray, shape (m, 3)
            Points in mm.
        neighbours : int
            Number of fixed points around each; fewer in a smaller cloud.

        Returns
        -------
        patches_mm : ndarray, shape (m, k, 3)
            Fixed points around each point, the nearest first, in mm.
        away_mm : ndarray, shape (m, k)
            Their distances in mm.
        """
        if (
            self._around is not None
            and points_mm is self.points_mm
            and neighbours <= self._around[0].shape[1]
        ):
            away_mm, index = (known[:, :neighbours] for known in self._around)
        else:
            away_mm, index = self._nearest(points_mm, neighbours)
        return self.points_mm[index], away_mm

    def _nearest(self, points_mm: np.ndarray, neighbours: int) -> tuple[np.ndarray, np.ndarray]:
        index, squared_mm2 = self._tree.batch_knn_search(points_mm, min(neighbours, len(self.points_mm)))
        return np.sqrt(squared_mm2), np.asarray(index, dtype=np.int64)

    def neighbours_of(self, count: int) -> Int64[np.ndarray, "n k"]:
        """Find the fixed points nearest to each fixed point.

        Parameters
        ----------
        count : int
            Number of neighbours, the point itself included.

        Returns
        -------
        ndarray of int, shape (n, k)
            Indices, the point itself first.
        """
        if self._around is not None and count <= self._around[1].shape[1]:
            return self._around[1][:, :count]
        return self._nearest(self.points_mm, count)[1]

    def away_mm(self, neighbour: int) -> Float64[np.ndarray, " n"]:
        """Measure how far one of its neighbours is from each fixed point.

        Parameters
        ----------
        neighbour : int
            Rank of the neighbour; 0 is the point itself.

        Returns
        -------
        ndarray, shape (n,)
            Distances in mm.
        """
        if self._around is not None and neighbour < self._around[0].shape[1]:
            return self._around[0][:, neighbour]
        return self._nearest(self.points_mm, neighbour + 1)[0][:, -1]

    def face_like(self, normals: Float64[np.ndarray, "n 3"]) -> None:
        """Flip normals to the side that given ones point to.

        Parameters
        ----------
        normals : ndarray, shape (n, 3)
            Normals to follow, one for each fixed point.
        """
        if self.normals is not None:
            facing = np.einsum("nk,nk->n", self.normals, normals)
            self.normals = self.normals * np.where(facing < 0, -1.0, 1.0)[:, None]

    def closest(self, points_mm: Float64[np.ndarray, "m 3"]) -> Int64[np.ndarray, " m"]:
        """Find the closest fixed point of each point.

        Parameters
        ----------
        points_mm : ndarray, shape (m, 3)
            Points in mm.

        Returns
        -------
        ndarray of int, shape (m,)
            Indices of the fixed points.
        """
        return np.asarray(self._tree.batch_nearest_neighbor_search(points_mm)[0], dtype=np.int64)

    def distances_mm(self, points_mm: Float64[np.ndarray, "m 3"]) -> Float64[np.ndarray, " m"]:
        """Measure the distance from each point to the closest fixed one.

        Parameters
        ----------
        points_mm : ndarray, shape (m, 3)
            Points in mm.

        Returns
        -------
        ndarray, shape (m,)
            Distances in mm.
        """
        return np.sqrt(self._tree.batch_nearest_neighbor_search(points_mm)[1])

    @cached_property
    def spacing_mm(self) -> float:
        """Median distance in mm from a fixed point to its nearest neighbour; infinite for a single point."""
        if len(self.points_mm) < 2:
            return float("inf")
        return float(np.median(self._nearest(self.points_mm, 2)[0][:, 1]))


def principal_axes(patches_mm: Float64[np.ndarray, "m k 3"]) -> Float64[np.ndarray, "m 3 3"]:
    """Compute the principal axes of each patch.

    Parameters
    ----------
    patches_mm : ndarray, shape (m, k, 3)
        Points of each patch in mm.

    Returns
    -------
    ndarray, shape (m, 3, 3)
        Unit axes in columns, the one of least spread first.
    """
    centred_mm = patches_mm - patches_mm.mean(axis=1, keepdims=True)
    return np.linalg.eigh(np.swapaxes(centred_mm, 1, 2) @ centred_mm)[1]


class VoxelTarget:
    """Closest points by a lookup table over a voxel grid: wrong by up to a voxel's diagonal, and far faster.

    The fixed points are averaged within each voxel; the table holds for every voxel the average nearest to it
    (exact Euclidean feature transform). Points outside the grid take the value at its border.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3)
        Fixed points in mm.
    cells : int
        Number of voxels along the longest side of the cloud.
    margin : float, optional
        Share of that side added around the cloud.
    exact : TreeTarget or None, optional
        Cloud from whose closest point an average takes its normal; None gives no normals.
    """

    def __init__(
        self,
        points_mm: Float64[np.ndarray, "n 3"],
        cells: int,
        margin: float = 0.25,
        exact: TreeTarget | None = None,
    ) -> None:
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
        if exact is not None and exact.normals is not None:
            self.normals = exact.normals[exact.closest(self.points_mm)]
        grid = np.full(int(self._shape.prod()), -1, dtype=np.int64)
        grid[occupied] = np.arange(len(occupied))
        grid = grid.reshape(self._shape)
        nearest = distance_transform_edt(grid < 0, return_distances=False, return_indices=True)
        self._table = grid[tuple(nearest)].ravel()

    def _flat(self, points_mm: np.ndarray) -> np.ndarray:
        cell = ((points_mm - self._origin_mm) / self._step_mm).astype(np.int64)
        np.clip(cell, 0, self._shape - 1, out=cell)
        return (cell[:, 0] * self._shape[1] + cell[:, 1]) * self._shape[2] + cell[:, 2]

    def closest(self, points_mm: Float64[np.ndarray, "m 3"]) -> Int64[np.ndarray, " m"]:
        """Find the averaged fixed point that is nearest to the voxel of each point.

        Parameters
        ----------
        points_mm : ndarray, shape (m, 3)
            Points in mm.

        Returns
        -------
        ndarray of int, shape (m,)
            Indices of the averaged points.
        """
        return self._table[self._flat(points_mm)]
