"""Local features of a cloud: what the surface around each point looks like, whichever way it is turned."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float64

from registration.checks import require_count, require_positive
from registration.errors import InputError
from registration.geometry.open3d_bridge import import_open3d, point_body
from registration.geometry.point_cloud import with_normals

# A thinned cloud needs so many points before the neighbourhood of any of them says something about its shape.
MIN_POINTS = 10


@dataclass(frozen=True)
class FpfhFeatures:
    """Fast point feature histograms of a cloud thinned to one point a voxel.

    Normals are turned out of the vessel: a histogram counts angles between them, so those of both clouds must point to
    the same side.

    Parameters
    ----------
    voxel_mm : float
        Side of a voxel in mm.
    radius_mm : float
        Reach of a feature in mm.
    neighbours : int, optional
        Largest number of points in a feature.
    normal_neighbours : int, optional
        Number of points that a normal is estimated from.

    Raises
    ------
    InputError
        If a setting is outside its range, or the reach is not larger than a voxel.

    References
    ----------
    R. B. Rusu, N. Blodow and M. Beetz, ICRA 2009.
    """

    voxel_mm: float
    radius_mm: float
    neighbours: int = 100
    normal_neighbours: int = 20

    def __post_init__(self) -> None:
        require_positive("voxel_mm", self.voxel_mm)
        require_positive("radius_mm", self.radius_mm)
        require_count("neighbours", self.neighbours, 3)
        require_count("normal_neighbours", self.normal_neighbours, 3)
        if self.radius_mm <= self.voxel_mm:
            raise InputError(
                f"radius_mm: expected more than voxel_mm ({self.voxel_mm:g}), received {self.radius_mm:g}"
            )

    def __call__(self, points_mm: Float64[np.ndarray, "n 3"], name: str) -> tuple[Any, Any]:
        """Compute the features of a cloud.

        Parameters
        ----------
        points_mm : ndarray, shape (n, 3)
            Points in mm.
        name : str
            Name of the cloud, for messages.

        Returns
        -------
        thinned : open3d.geometry.PointCloud
            Thinned cloud with normals.
        features : open3d.pipelines.registration.Feature
            A feature for each of its points.

        Raises
        ------
        InputError
            If too few points are left.
        """
        open3d = import_open3d()
        cloud = point_body(points_mm)
        thinned_mm = np.asarray(cloud.voxel_down_sample(self.voxel_mm).points)
        if len(thinned_mm) < MIN_POINTS:
            raise InputError(
                f"{name}: expected at least {MIN_POINTS} points a voxel of {self.voxel_mm:g} mm apart, "
                f"received {len(thinned_mm)}"
            )
        oriented = with_normals(thinned_mm, min(self.normal_neighbours, len(thinned_mm)))
        thinned = point_body(oriented.points_mm, oriented.normals)
        search = open3d.geometry.KDTreeSearchParamHybrid(self.radius_mm, self.neighbours)
        return thinned, open3d.pipelines.registration.compute_fpfh_feature(thinned, search)
