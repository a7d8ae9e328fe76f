"""Surfaces through oriented point clouds: screened Poisson reconstruction and ball pivoting."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np

from registration.checks import require_at_least, require_positive, require_positive_each
from registration.errors import InputError
from registration.geometry.mesh_topology import keep_triangles, largest_piece
from registration.geometry.open3d_bridge import import_open3d, point_body
from registration.geometry.point_cloud import OrientedCloud, require_oriented, with_surface_normals
from registration.geometry.shapes import Mesh
from registration.reconstruction.open_ends import measured_part


@runtime_checkable
class SurfaceMethod(Protocol):
    """A method of surface reconstruction."""

    def __call__(self, cloud: OrientedCloud) -> Mesh:
        """Reconstruct the surface that the points lie on.

        Parameters
        ----------
        cloud : OrientedCloud
            Points with outward unit normals.

        Returns
        -------
        Mesh
            The surface in the cloud's coordinate frame.
        """


@dataclass(frozen=True)
class PoissonSurface:
    """Screened Poisson reconstruction, open where the measured points end.

    Parameters
    ----------
    cell_mm : float
        Edge length of the finest cells in mm.
    bridge_mm : float
        Widest gap in mm between measured points that is closed; past the last points the surface is cut
        instead of bulging out. 0 leaves the surface closed.
    normal_reach_mm : float, optional
        Radius in mm within which normals are fitted to the points before; 0 takes them as they are.
    trim_share : float, optional
        Share of vertices of lowest density that is removed, below 1; it cannot distinguish a bulge from a
        sparsely measured wall.
    largest : bool, optional
        Whether only the largest connected piece is kept.

    Raises
    ------
    InputError
        If a value is out of range.

    References
    ----------
    M. Kazhdan and H. Hoppe, ACM Trans. Graph. 32(3), 2013.
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
        """Reconstruct the surface that the points lie on.

        Parameters
        ----------
        cloud : OrientedCloud
            Points with outward unit normals.

        Returns
        -------
        Mesh
            The surface in the cloud's coordinate frame, oriented outwards.

        Raises
        ------
        InputError
            If normals are not of unit length or the points span no surface.
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
    """Ball pivoting: triangles that a ball rolled over the points rests on.

    The points become vertices: noise is not averaged, and downsampling the cloud first makes the triangles
    even.

    Parameters
    ----------
    radii_mm : sequence of float
        Radii of the balls in mm. A gap wider than the largest ball stays open, so open ends do too.
    largest : bool, optional
        Whether only the largest connected piece is kept.

    Raises
    ------
    InputError
        If there is no radius or one is not positive.

    References
    ----------
    F. Bernardini et al., IEEE TVCG 5(4), 1999.
    """

    radii_mm: Sequence[float]
    largest: bool = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "radii_mm", require_positive_each("radii_mm", self.radii_mm, "radius"))

    def __call__(self, cloud: OrientedCloud) -> Mesh:
        """Reconstruct the surface that the points lie on.

        Parameters
        ----------
        cloud : OrientedCloud
            Points with outward unit normals.

        Returns
        -------
        Mesh
            The surface in the cloud's coordinate frame.

        Raises
        ------
        InputError
            If normals are not of unit length or no ball rests on three points.
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
