"""Distances between two surfaces after registration, and the error of a pose against the truth.

Distances from a point to a mesh are to its triangles, so that they do not fall as the mesh gets denser; only where
the other side has no triangles are they to its points. Nothing here turns a failure into a number: what is not
defined raises InputError.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float64
from scipy.spatial import cKDTree

from registration import transforms
from registration.brief import brief_repr
from registration.checks import require_count, require_positive
from registration.errors import InputError
from registration.geometry.open3d_bridge import TriangleScene
from registration.geometry.shapes import Mesh, Surface, require_cloud, sampled, transformed

# A mesh, or the points of a cloud; the axis has no name, because two surfaces differ in size.

# Success is a residual, or a target registration error, of at most so much; the second is what counts.
SUCCESS_RMSE_MM, SUCCESS_TRE_MM = 1.0, 2.0


class SurfaceDistance:
    """Unsigned distances from points to one surface, prepared once for many queries.

    To triangles by Open3D's ray-casting scene (single precision: coordinates are taken from the surface's
    centre, so that the distance of a vessel far from the origin keeps its digits), to points by a k-d tree.

    Parameters
    ----------
    surface : Surface
        Mesh, or points (n, 3) in mm.

    Raises
    ------
    InputError
        If the mesh has no triangles or the points are no cloud.
    """

    def __init__(self, surface: Surface) -> None:
        self._scene: TriangleScene | None = None
        self._tree: Any = None
        if not isinstance(surface, Mesh):
            self._tree = cKDTree(require_cloud(surface, "surface"))
            return
        if not len(surface.triangles):
            raise InputError("surface: expected a mesh with triangles, received none")
        used_mm = surface.vertices_mm[np.unique(surface.triangles)]
        self._scene = TriangleScene(surface, 0.5 * (used_mm.min(axis=0) + used_mm.max(axis=0)))

    def __call__(self, points_mm: Float64[np.ndarray, "m 3"]) -> Float64[np.ndarray, " m"]:
        """Measure the distance of each point to the surface.

        Parameters
        ----------
        points_mm : ndarray, shape (m, 3)
            Points in the surface's coordinate frame in mm.

        Returns
        -------
        ndarray, shape (m,)
            Distances in mm.

        Raises
        ------
        InputError
            If a coordinate is not finite.
        """
        if not np.isfinite(points_mm).all():
            raise InputError("points_mm: expected finite coordinates, received NaN or infinity")
        if self._scene is not None:
            return self._scene.distance_mm(points_mm)
        return np.asarray(self._tree.query(points_mm)[0], dtype=np.float64)


@dataclass(frozen=True)
class SurfaceResiduals:
    """Distances between a moved and a fixed surface.

    Parameters
    ----------
    rmse_mm : float
        Root mean square from moved to fixed in mm.
    rmse_trimmed_mm : float
        The same over the closest share.
    rmse_bidirectional_mm : float
        Root of the mean of both directions' mean squares in mm.
    msd_mm : float
        Mean of both directions' mean distances in mm.
    hd95_mm : float
        Larger of both directions' 95th percentiles in mm.
    inlier_share : float
        Share of the moved surface within the inlier distance of the fixed one.
    coverage : float
        Share of the fixed surface within the inlier distance of the moved one.
    """

    rmse_mm: float
    rmse_trimmed_mm: float
    rmse_bidirectional_mm: float
    msd_mm: float
    hd95_mm: float
    inlier_share: float
    coverage: float

    __repr__ = brief_repr


def surface_residuals(
    moving: Surface,
    fixed: Surface,
    fixed_T_moving: Float64[np.ndarray, "4 4"],
    *,
    inlier_mm: float,
    keep: float,
    samples: int = 10_000,
    seed: int = 0,
) -> SurfaceResiduals:
    """Measure the distances between a moved and a fixed surface, both ways.

    Parameters
    ----------
    moving, fixed : Surface
        Surfaces in mm. A mesh is sampled uniformly by area; the points of a cloud are used as they are.
    fixed_T_moving : ndarray, shape (4, 4)
        Pose that brings the moving surface over.
    inlier_mm : float
        Inlier distance in mm.
    keep : float
        Share of smallest distances in the trimmed residual, above 0 to 1.
    samples : int, optional
        Number of points that a mesh is sampled at.
    seed : int, optional
        Seed of the sampling.

    Returns
    -------
    SurfaceResiduals
        The residuals.

    Raises
    ------
    InputError
        If a value is out of range, the pose is not rigid, or a surface has no triangles or points.
    """
    require_positive("inlier_mm", inlier_mm)
    require_positive("keep", keep, 1.0)
    require_count("samples", samples, 1)
    transforms.require_rigid(fixed_T_moving, "fixed_T_moving")
    moved = transformed(moving, fixed_T_moving)
    draws = np.random.default_rng(seed).spawn(2)
    there_mm = SurfaceDistance(fixed)(sampled(moved, samples, draws[0]))
    back_mm = SurfaceDistance(moved)(sampled(fixed, samples, draws[1]))
    return SurfaceResiduals(
        rmse_mm=rms(there_mm),
        rmse_trimmed_mm=trimmed_rms(there_mm, keep),
        rmse_bidirectional_mm=float(np.sqrt(0.5 * ((there_mm**2).mean() + (back_mm**2).mean()))),
        msd_mm=float(0.5 * (there_mm.mean() + back_mm.mean())),
        hd95_mm=float(max(np.percentile(there_mm, 95), np.percentile(back_mm, 95))),
        inlier_share=float((there_mm <= inlier_mm).mean()),
        coverage=float((back_mm <= inlier_mm).mean()),
    )


@dataclass(frozen=True)
class PoseError:
    """Errors of an estimated pose.

    Parameters
    ----------
    tre_mm, tre_max_mm : float
        Root mean square and largest displacement of the targets in mm.
    rotation_error_deg : float
        Angle between estimated and true pose in degrees.
    translation_error_mm : float
        Displacement of the targets' centroid in mm.
    """

    tre_mm: float
    tre_max_mm: float
    rotation_error_deg: float
    translation_error_mm: float

    __repr__ = brief_repr


def pose_error(
    fixed_T_moving: Float64[np.ndarray, "4 4"],
    true_fixed_T_moving: Float64[np.ndarray, "4 4"],
    targets_mm: Float64[np.ndarray, "t 3"],
) -> PoseError:
    """Measure the target registration error of a pose.

    Parameters
    ----------
    fixed_T_moving : ndarray, shape (4, 4)
        Estimated pose.
    true_fixed_T_moving : ndarray, shape (4, 4)
        True pose.
    targets_mm : ndarray, shape (t, 3)
        Targets in the fixed coordinate frame in mm, where the truth puts them.

    Returns
    -------
    PoseError
        Errors of the pose.

    Raises
    ------
    InputError
        If a pose is not rigid or there are no finite targets.

    Notes
    -----
    The estimate puts the same moving point elsewhere than the truth; the distance between both places is a
    target's error. Translation depends on the origin, which is far from a vessel as a rule: it is therefore
    given at the targets' centroid.

    References
    ----------
    J. M. Fitzpatrick et al., IEEE TMI 17(5), 1998.
    """
    if not len(targets_mm) or not np.isfinite(targets_mm).all():
        raise InputError(f"targets_mm: expected finite targets, received {len(targets_mm)} with NaN or none")
    estimate = transforms.require_rigid(fixed_T_moving, "fixed_T_moving")
    truth = transforms.require_rigid(true_fixed_T_moving, "true_fixed_T_moving")
    error = transforms.compose(estimate, transforms.invert_rigid(truth))
    apart_mm = np.linalg.norm(transforms.apply(error, targets_mm) - targets_mm, axis=1)
    centre_mm = targets_mm.mean(axis=0)
    return PoseError(
        tre_mm=rms(apart_mm),
        tre_max_mm=float(apart_mm.max()),
        rotation_error_deg=float(transforms.rotation_angle_deg(error)),
        translation_error_mm=float(np.linalg.norm(transforms.apply(error, centre_mm) - centre_mm)),
    )


def rms(distances_mm: Float64[np.ndarray, " n"]) -> float:
    """Compute the root mean square.

    Parameters
    ----------
    distances_mm : ndarray, shape (n,)
        Distances in mm.

    Returns
    -------
    float
        Root mean square in mm.

    Raises
    ------
    InputError
        If there is no distance.
    """
    if not len(distances_mm):
        raise InputError("distances_mm: expected at least one distance, received none")
    return float(np.sqrt((distances_mm**2).mean()))


def trimmed_rms(distances_mm: Float64[np.ndarray, " n"], keep: float) -> float:
    """Compute the root mean square of the smallest distances.

    Parameters
    ----------
    distances_mm : ndarray, shape (n,)
        Distances in mm.
    keep : float
        Share of the distances that counts, above 0 to 1; at least one does.

    Returns
    -------
    float
        Root mean square in mm.

    Raises
    ------
    InputError
        If there is no distance or the share is out of range.
    """
    require_positive("keep", keep, 1.0)
    count = max(int(np.ceil(keep * len(distances_mm) - 1e-9)), 1)
    return rms(np.sort(distances_mm)[:count])
