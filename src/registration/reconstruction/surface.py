"""Surfaces through clouds of points with normals: Poisson reconstruction and ball pivoting behind one call."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np

from registration.checks import require_at_least, require_positive
from registration.errors import InputError
from registration.geometry.mesh_topology import keep_triangles, largest_piece
from registration.geometry.open3d_bridge import import_open3d, point_body
from registration.geometry.point_cloud import OrientedCloud, require_oriented, with_surface_normals
from registration.geometry.shapes import Mesh
from registration.reconstruction.open_ends import measured_part


@runtime_checkable
class SurfaceMethod(Protocol):
    """What every reconstruction is: a call from a cloud to a surface."""

    def __call__(self, cloud: OrientedCloud) -> Mesh:
        """Reconstruct the surface that the points lie on."""


@dataclass(frozen=True)
class PoissonSurface:
    """Screened Poisson reconstruction (Kazhdan and Hoppe, ACM Trans. Graph. 32(3), 2013), open where the vessel is.

    ``cell_mm`` is the size of the finest cell. ``bridge_mm`` is the widest gap that is closed between measured points:
    past the last of them the surface is cut along the line where they end, instead of bulging out. 0 leaves the
    surface closed. ``trim_share`` takes off the vertices of least density, as is usual; it cannot tell a bulge from a
    thinly measured wall. ``normal_reach_mm`` fits normals to the points around each before (0 takes them as they
    are).
    """

    cell_mm: float
    bridge_mm: float
    normal_reach_mm: float = 0.0
    trim_share: float = 0.0
    largest: bool = True

    def __post_init__(self) -> None:
        require_positive("cell_mm", self.cell_mm)
        for name in ("bridge_mm", "normal_reach_mm", "trim_share"):
            require_at_least(name, getattr(self, name), 0.0)
        if self.trim_share >= 1:
            raise InputError(f"trim_share: expected a share below 1, received {self.trim_share:g}")

    def __call__(self, cloud: OrientedCloud) -> Mesh:
        """The surface in the cloud's frame, wound outwards, in one piece if ``largest``.

        Raises InputError for a cloud without unit normals or that spans no surface.
        """
        require_oriented(cloud)
        if self.normal_reach_mm > 0:
            cloud = with_surface_normals(cloud, self.normal_reach_mm)
        open3d = import_open3d()
        middle_mm = cloud.points_mm.mean(axis=0)
        body = _body(cloud, middle_mm)
        found, density = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
            body, depth=0, width=self.cell_mm, linear_fit=True, n_threads=1
        )
        mesh = _mesh(found, middle_mm)
        if not len(mesh.triangles):
            raise InputError(
                f"cloud: expected points that a surface fits, received {len(cloud)} that none does"
            )
        if self.trim_share > 0:
            thick = np.asarray(density) >= np.quantile(np.asarray(density), self.trim_share)
            mesh = keep_triangles(mesh, thick[mesh.triangles].all(axis=1))
        if self.bridge_mm > 0:
            mesh = measured_part(mesh, cloud, self.bridge_mm)
        return largest_piece(mesh) if self.largest else mesh


@dataclass(frozen=True)
class BallPivotingSurface:
    """Triangles that a ball of each radius rests on, rolled over the points (Bernardini et al., IEEE TVCG 5(4), 1999).

    ``radii_mm`` go from small to large; a gap wider than the largest ball stays open, so ends do too. The points
    themselves become vertices: noise is not averaged, and thinning the cloud first makes the triangles even.
    """

    radii_mm: Sequence[float]
    largest: bool = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "radii_mm", tuple(self.radii_mm))
        if not self.radii_mm:
            raise InputError("radii_mm: expected at least one radius, received none")
        for radius_mm in self.radii_mm:
            require_positive("radii_mm", radius_mm)

    def __call__(self, cloud: OrientedCloud) -> Mesh:
        """The surface in the cloud's frame, in one piece if ``largest``.

        Raises InputError for a cloud without unit normals or whose points no ball rests on.
        """
        require_oriented(cloud)
        open3d = import_open3d()
        middle_mm = cloud.points_mm.mean(axis=0)
        found = open3d.geometry.TriangleMesh.create_from_point_cloud_ball_pivoting(
            _body(cloud, middle_mm), open3d.utility.DoubleVector(sorted(self.radii_mm))
        )
        mesh = _mesh(found, middle_mm)
        if not len(mesh.triangles):
            raise InputError(f"radii_mm: expected balls that rest on three points, received {self.radii_mm}")
        return largest_piece(mesh) if self.largest else mesh


def _body(cloud: OrientedCloud, middle_mm: np.ndarray) -> Any:
    return point_body(cloud.points_mm - middle_mm, cloud.normals)


def _mesh(found: Any, middle_mm: np.ndarray) -> Mesh:
    vertices_mm = np.asarray(found.vertices, dtype=np.float64).reshape(-1, 3) + middle_mm
    return Mesh(vertices_mm, np.asarray(found.triangles, dtype=np.int64).reshape(-1, 3))
