"""Open3D behind one door: meshes and clouds of ours in its types, and rays and distances to triangles.

Open3D is imported only where it is needed, because that takes a second; its type stubs are not right, so that its
objects are ``Any`` here and arrays of NumPy everywhere else.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Float64, Int64

from registration.geometry.shapes import Mesh


def import_open3d() -> Any:
    """Import Open3D.

    Returns
    -------
    module
        The module ``open3d``.
    """
    import open3d

    return open3d


@contextmanager
def quiet_open3d() -> Iterator[Any]:
    """Import Open3D and keep it from printing warnings, for what the caller checks itself.

    Yields
    ------
    module
        The module ``open3d``.
    """
    open3d = import_open3d()
    with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
        yield open3d


def triangle_body(mesh: Mesh) -> Any:
    """Convert a mesh to Open3D's.

    Parameters
    ----------
    mesh : Mesh
        Mesh in mm.

    Returns
    -------
    open3d.geometry.TriangleMesh
        The same vertices and triangles.
    """
    open3d = import_open3d()
    return open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(mesh.vertices_mm),
        open3d.utility.Vector3iVector(mesh.triangles.astype(np.int32)),
    )


def point_body(
    points_mm: Float64[np.ndarray, "n 3"], normals: Float64[np.ndarray, "n 3"] | None = None
) -> Any:
    """Convert points to Open3D's cloud.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3)
        Points in mm.
    normals : ndarray, shape (n, 3), optional
        Unit normals; None leaves the cloud without.

    Returns
    -------
    open3d.geometry.PointCloud
        The same points and normals.
    """
    open3d = import_open3d()
    body = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points_mm))
    if normals is not None:
        body.normals = open3d.utility.Vector3dVector(normals)
    return body


@dataclass(frozen=True)
class ClosestOnTriangles:
    """The closest place on a mesh's triangles to each of n points.

    Parameters
    ----------
    places_mm : ndarray, shape (n, 3)
        Closest places in the mesh's coordinate frame in mm.
    offsets_mm : ndarray, shape (n, 3)
        From each point to its closest place in mm.
    triangles : ndarray, shape (n,)
        Index of the triangle on which the place lies.
    second_third : ndarray, shape (n, 2)
        Barycentric weights of that triangle's second and third corner.
    normals : ndarray, shape (n, 3)
        Unit normal of that triangle.
    """

    places_mm: Float64[np.ndarray, "n 3"]
    offsets_mm: Float64[np.ndarray, "n 3"]
    triangles: Int64[np.ndarray, " n"]
    second_third: Float64[np.ndarray, "n 2"]
    normals: Float64[np.ndarray, "n 3"]


class TriangleScene:
    """Distances and rays to the triangles of a mesh, by Open3D's ray-casting scene.

    The scene computes in single precision: coordinates are counted from ``origin_mm``, so that a vessel far from the
    origin keeps its digits.

    Parameters
    ----------
    mesh : Mesh
        Mesh in mm with at least one triangle.
    origin_mm : ndarray, shape (3,), optional
        Place near the mesh in mm; None takes the mean of its vertices.
    """

    def __init__(self, mesh: Mesh, origin_mm: Float64[np.ndarray, "3"] | None = None) -> None:
        self._open3d = import_open3d()
        self._origin_mm = mesh.vertices_mm.mean(axis=0) if origin_mm is None else origin_mm
        self._scene = self._open3d.t.geometry.RaycastingScene()
        self._scene.add_triangles(
            self._tensor(mesh.vertices_mm), self._open3d.core.Tensor(mesh.triangles.astype(np.uint32))
        )

    def distance_mm(self, points_mm: Float[np.ndarray, "*n 3"]) -> Float64[np.ndarray, " *n"]:
        """Measure the unsigned distance of each point to the triangles.

        Parameters
        ----------
        points_mm : ndarray, shape (..., 3)
            Points in the mesh's coordinate frame in mm.

        Returns
        -------
        ndarray, shape (...)
            Distances in mm.
        """
        return self._scene.compute_distance(self._tensor(points_mm)).numpy().astype(np.float64)

    def occupied(self, points_mm: Float[np.ndarray, "*n 3"]) -> Bool[np.ndarray, " *n"]:
        """Decide by the majority of three rays' parities which points lie inside, for a closed mesh.

        Parameters
        ----------
        points_mm : ndarray, shape (..., 3)
            Points in the mesh's coordinate frame in mm.

        Returns
        -------
        ndarray, shape (...)
            True for points inside.
        """
        found: np.ndarray = self._scene.compute_occupancy(self._tensor(points_mm), nsamples=3).numpy()
        return found > 0

    def closest(self, points_mm: Float64[np.ndarray, "n 3"]) -> ClosestOnTriangles:
        """Find the closest place on the triangles to each point.

        Parameters
        ----------
        points_mm : ndarray, shape (n, 3)
            Points in the mesh's coordinate frame in mm.

        Returns
        -------
        ClosestOnTriangles
            Places, offsets, triangles, barycentric weights and normals.
        """
        queried_mm = (points_mm - self._origin_mm).astype(np.float32)
        found = self._scene.compute_closest_points(self._open3d.core.Tensor(queried_mm))
        places_mm = found["points"].numpy().astype(np.float64)
        return ClosestOnTriangles(
            places_mm=places_mm + self._origin_mm,
            offsets_mm=places_mm - queried_mm,
            triangles=found["primitive_ids"].numpy().astype(np.int64),
            second_third=found["primitive_uvs"].numpy().astype(np.float64),
            normals=found["primitive_normals"].numpy().astype(np.float64),
        )

    def cast(
        self, from_mm: Float64[np.ndarray, "n 3"], directions: Float64[np.ndarray, "n 3"]
    ) -> tuple[Float64[np.ndarray, " n"], Int64[np.ndarray, " n"]]:
        """Cast rays and find the first triangle that each meets.

        Parameters
        ----------
        from_mm : ndarray, shape (n, 3)
            Where the rays start, in the mesh's coordinate frame in mm.
        directions : ndarray, shape (n, 3)
            Unit vectors along them.

        Returns
        -------
        distance_mm : ndarray, shape (n,)
            Length of each ray in mm, infinite where it meets nothing.
        triangles : ndarray, shape (n,)
            Index of the triangle met, 2^32 - 1 where none is.
        """
        rays = np.concatenate([from_mm - self._origin_mm, directions], axis=1).astype(np.float32)
        hits = self._scene.cast_rays(self._open3d.core.Tensor(rays))
        return hits["t_hit"].numpy().astype(np.float64), hits["primitive_ids"].numpy().astype(np.int64)

    def _tensor(self, points_mm: np.ndarray) -> Any:
        return self._open3d.core.Tensor((points_mm - self._origin_mm).astype(np.float32))
