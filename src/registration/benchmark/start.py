"""Where a benchmark case starts: points drawn from sweep and model, stray points, and a random pose.

The draws are the benchmark's own, so that its cases stay what they are whatever becomes of the robustness study's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from registration import frames

ANGLE_MAX_DEG, TRANSLATION_MAX_MM = 180.0, 50.0


@dataclass(frozen=True)
class Start:
    """A pose that a cloud is moved to: ``moved_T_true``, the angle of its turn and the length of its shift."""

    moved_T_true: Float64[np.ndarray, "4 4"]
    angle_deg: float
    translation_mm: float


@dataclass(frozen=True)
class DrawnPoints:
    """Points of a cloud: ``points_mm`` (m, 3), their places in it, ``index`` (m,), and which are stray, ``outlier``.

    A stray point has the index of the point that is nearest to it.
    """

    points_mm: Float64[np.ndarray, "m 3"]
    index: Int64[np.ndarray, "m"]
    outlier: Bool[np.ndarray, "m"]


def draw_start(points_mm: Float64[np.ndarray, "m 3"], rng: np.random.Generator) -> Start:
    """Draw a start: axis uniform on the sphere, angle uniform to 180 degrees, about the centroid; shift to 50 mm."""
    axis, angle = _direction(rng), np.deg2rad(rng.uniform(0.0, ANGLE_MAX_DEG))
    shift_mm = rng.uniform(0.0, TRANSLATION_MAX_MM) * _direction(rng)
    turn = Rotation.from_rotvec(angle * axis)
    moved_T_true = frames.compose(
        frames.translation(shift_mm), frames.rotate_about(turn, points_mm.mean(axis=0))
    )
    return Start(moved_T_true, float(np.rad2deg(angle)), float(np.linalg.norm(shift_mm)))


def draw_points(
    cloud_mm: Float64[np.ndarray, "p 3"], most: int, outlier_share: float, rng: np.random.Generator
) -> DrawnPoints:
    """At most ``most`` points of a cloud in random order, a share of them replaced by stray ones.

    Stray points are uniform in the cloud's bounding box grown by half its size on every side.
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


def _direction(rng: np.random.Generator) -> Float64[np.ndarray, "3"]:
    """Uniform on the sphere: a normal vector has no preferred direction."""
    vector = rng.standard_normal(3)
    return vector / np.linalg.norm(vector)
