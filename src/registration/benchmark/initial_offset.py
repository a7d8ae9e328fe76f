"""Start of a benchmark case: points drawn from sweep and model, outliers, and a random pose.

The draws are the benchmark's own, so that its cases stay what they are whatever becomes of the robustness study's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from registration import transforms

ANGLE_MAX_DEG, TRANSLATION_MAX_MM = 180.0, 50.0


@dataclass(frozen=True)
class Start:
    """Random pose that a cloud is moved to.

    Parameters
    ----------
    moved_T_true : ndarray, shape (4, 4)
        Rigid transform from the true to the moved cloud.
    angle_deg : float
        Angle of its rotation in degrees.
    translation_mm : float
        Length of its translation in mm.
    """

    moved_T_true: Float64[np.ndarray, "4 4"]
    angle_deg: float
    translation_mm: float


@dataclass(frozen=True)
class DrawnPoints:
    """Points drawn from a cloud.

    Parameters
    ----------
    points_mm : ndarray, shape (m, 3)
        Points in mm.
    index : ndarray of int, shape (m,)
        Index of each in the cloud; for an outlier that of the cloud's nearest point.
    outlier : ndarray of bool, shape (m,)
        Which points are outliers.
    """

    points_mm: Float64[np.ndarray, "m 3"]
    index: Int64[np.ndarray, " m"]
    outlier: Bool[np.ndarray, " m"]


def draw_start(points_mm: Float64[np.ndarray, "m 3"], rng: np.random.Generator) -> Start:
    """Draw a start.

    The rotation is about the centroid, its axis uniform on the sphere, its angle uniform to 180 degrees; the
    translation has a uniform direction and a length uniform to 50 mm.

    Parameters
    ----------
    points_mm : ndarray, shape (m, 3)
        Points of the cloud in mm.
    rng : numpy.random.Generator
        Random stream of the start.

    Returns
    -------
    Start
        The start.
    """
    axis, angle = random_direction(rng), np.deg2rad(rng.uniform(0.0, ANGLE_MAX_DEG))
    shift_mm = rng.uniform(0.0, TRANSLATION_MAX_MM) * random_direction(rng)
    turn = Rotation.from_rotvec(angle * axis)
    moved_T_true = transforms.compose(
        transforms.translation(shift_mm), transforms.rotate_about(turn, points_mm.mean(axis=0))
    )
    return Start(moved_T_true, float(np.rad2deg(angle)), float(np.linalg.norm(shift_mm)))


def draw_points(
    cloud_mm: Float64[np.ndarray, "p 3"], most: int, outlier_share: float, rng: np.random.Generator
) -> DrawnPoints:
    """Draw points of a cloud in random order and replace a share of them by outliers.

    Outliers are uniform in the cloud's bounding box grown by half its size on every side.

    Parameters
    ----------
    cloud_mm : ndarray, shape (p, 3)
        Points of the cloud in mm.
    most : int
        Largest number of points.
    outlier_share : float
        Share of outliers.
    rng : numpy.random.Generator
        Random stream of the draw.

    Returns
    -------
    DrawnPoints
        Points, indices and outliers.
    """
    index = rng.permutation(len(cloud_mm))[:most]
    points_mm = cloud_mm[index]
    # The order is random already: which points are stray is not told by their place in the file.
    outlier = rng.permutation(len(index)) < round(outlier_share * len(index))
    low_mm, high_mm = points_mm.min(axis=0), points_mm.max(axis=0)
    grown_mm = 0.5 * (high_mm - low_mm)
    points_mm[outlier] = rng.uniform(low_mm - grown_mm, high_mm + grown_mm, size=(int(outlier.sum()), 3))
    index[outlier] = cKDTree(cloud_mm).query(points_mm[outlier])[1] if outlier.any() else 0
    return DrawnPoints(points_mm, index.astype(np.int64), outlier)


def random_direction(rng: np.random.Generator) -> Float64[np.ndarray, "3"]:
    """Draw a unit vector, uniform on the sphere: a normal vector has no preferred direction.

    Parameters
    ----------
    rng : numpy.random.Generator
        Random stream of the draw.

    Returns
    -------
    ndarray, shape (3,)
        The vector.
    """
    vector = rng.standard_normal(3)
    return vector / np.linalg.norm(vector)
