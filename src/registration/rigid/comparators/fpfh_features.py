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
    """Fast point feature histograms (Rusu, Blodow and Beetz, ICRA 2009) of a cloud thinned to one point a voxel.

    ``voxel_mm`` is the side of a voxel, ``radius_mm`` the reach of a feature, from at most ``neighbours`` points.
    Normals come from ``normal_neighbours`` points and are turned out of the vessel: a histogram counts angles between
    them, so those of both clouds must point to the same side.
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
        """The thinned cloud with normals, and its features, as Open3D has them.

        Raises InputError, by ``name``, for a cloud of which too little is left.
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
