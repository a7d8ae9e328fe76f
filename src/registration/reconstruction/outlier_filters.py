"""Filters for point clouds: downsampling and removal of outliers, each reporting which points it removed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic

import numpy as np
from jaxtyping import Bool, Int64
from scipy.spatial import cKDTree

from registration.brief import brief_repr
from registration.checks import require_count, require_positive
from registration.errors import InputError
from registration.geometry.mesh_topology import row_numbers
from registration.geometry.point_cloud import AnyCloud, take


@dataclass(frozen=True)
class Filtered(Generic[AnyCloud]):
    """Result of a filter.

    Parameters
    ----------
    cloud : AnyCloud
        The points that are left.
    removed : ndarray of int, shape (r,)
        Indices of the removed points in the cloud that was filtered.
    """

    cloud: AnyCloud
    removed: Int64[np.ndarray, " r"]

    __repr__ = brief_repr


@dataclass(frozen=True)
class VoxelDownsampling:
    """Downsampling to one point in each cubic cell: the point nearest to the mean of those in it.

    A point that is kept stays as it was measured, with its own mask and normal.

    Parameters
    ----------
    cell_mm : float
        Edge length of the cells in mm.

    Raises
    ------
    InputError
        If ``cell_mm`` is not positive.
    """

    cell_mm: float

    def __post_init__(self) -> None:
        require_positive("cell_mm", self.cell_mm)

    def __call__(self, cloud: AnyCloud) -> Filtered[AnyCloud]:
        """Downsample a cloud.

        Parameters
        ----------
        cloud : AnyCloud
            Points, with or without normals.

        Returns
        -------
        Filtered
            The cloud, its points in their order, and the removed indices.

        Raises
        ------
        InputError
            If a coordinate is not finite.
        """
        points_mm = _finite(cloud)
        if not len(points_mm):
            return Filtered(cloud, np.empty(0, dtype=np.int64))
        cells = np.floor((points_mm - points_mm.min(axis=0)) / self.cell_mm).astype(np.int64)
        _, owner, sizes = np.unique(row_numbers(cells), return_inverse=True, return_counts=True)
        means_mm = np.stack([np.bincount(owner, points_mm[:, axis]) / sizes for axis in range(3)], axis=1)
        apart_mm = np.linalg.norm(points_mm - means_mm[owner], axis=1)
        order = np.lexsort((apart_mm, owner))
        first = order[np.concatenate([[0], np.cumsum(sizes)[:-1]])]
        kept = np.zeros(len(points_mm), dtype=bool)
        kept[first] = True
        return _split(cloud, kept)


@dataclass(frozen=True)
class StatisticalOutlierRemoval:
    """Removal of points whose mean distance to their nearest neighbours is large within the cloud.

    The limit is the mean over the cloud plus ``deviations`` standard deviations.

    Parameters
    ----------
    neighbours : int, optional
        Number of nearest neighbours, at least 1.
    deviations : float, optional
        Number of standard deviations above the mean.

    Raises
    ------
    InputError
        If a value is out of range.

    References
    ----------
    R. B. Rusu et al., Robot. Auton. Syst. 56(11), 2008.
    """

    neighbours: int = 16
    deviations: float = 3.0

    def __post_init__(self) -> None:
        require_count("neighbours", self.neighbours, 1)
        require_positive("deviations", self.deviations)

    def __call__(self, cloud: AnyCloud) -> Filtered[AnyCloud]:
        """Remove the outliers of a cloud.

        Parameters
        ----------
        cloud : AnyCloud
            Points, with or without normals; one of no more than ``neighbours`` points is returned complete.

        Returns
        -------
        Filtered
            The cloud, its points in their order, and the removed indices.

        Raises
        ------
        InputError
            If a coordinate is not finite.
        """
        points_mm = _finite(cloud)
        if len(points_mm) <= self.neighbours:
            return Filtered(cloud, np.empty(0, dtype=np.int64))
        apart_mm = cKDTree(points_mm).query(points_mm, self.neighbours + 1)[0][:, 1:].mean(axis=1)
        return _split(cloud, apart_mm <= apart_mm.mean() + self.deviations * apart_mm.std())


@dataclass(frozen=True)
class RadiusOutlierRemoval:
    """Removal of isolated points.

    Parameters
    ----------
    radius_mm : float
        Radius in mm within which neighbours are counted.
    neighbours : int, optional
        Points with fewer neighbours are removed; at least 1.

    Raises
    ------
    InputError
        If a value is out of range.
    """

    radius_mm: float
    neighbours: int = 4

    def __post_init__(self) -> None:
        require_positive("radius_mm", self.radius_mm)
        require_count("neighbours", self.neighbours, 1)

    def __call__(self, cloud: AnyCloud) -> Filtered[AnyCloud]:
        """Remove the isolated points of a cloud.

        Parameters
        ----------
        cloud : AnyCloud
            Points, with or without normals.

        Returns
        -------
        Filtered
            The cloud, its points in their order, and the removed indices.

        Raises
        ------
        InputError
            If a coordinate is not finite.
        """
        points_mm = _finite(cloud)
        if not len(points_mm):
            return Filtered(cloud, np.empty(0, dtype=np.int64))
        # The distance to the last neighbour that must be near is enough, without a list of the others.
        wanted = min(self.neighbours + 1, len(points_mm))
        apart_mm = cKDTree(points_mm).query(points_mm, [wanted])[0][:, 0]
        enough = len(points_mm) > self.neighbours
        return _split(cloud, (apart_mm <= self.radius_mm) & enough)


def _finite(cloud: AnyCloud) -> np.ndarray:
    if not np.isfinite(cloud.points_mm).all():
        raise InputError("cloud: expected finite coordinates, received NaN or infinity")
    return cloud.points_mm


def _split(cloud: AnyCloud, kept: Bool[np.ndarray, " p"]) -> Filtered[AnyCloud]:
    return Filtered(take(cloud, np.flatnonzero(kept)), np.flatnonzero(~kept))
