"""Distances between surfaces, and the errors of a pose."""

from registration.metrics.surface_distance import (
    PoseError,
    SurfaceDistance,
    SurfaceResiduals,
    pose_error,
    rms,
    surface_residuals,
    trimmed_rms,
)

__all__ = [
    "PoseError",
    "SurfaceDistance",
    "SurfaceResiduals",
    "pose_error",
    "rms",
    "surface_residuals",
    "trimmed_rms",
]
