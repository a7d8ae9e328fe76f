"""Meshes, point clouds and what can be measured on them."""

from registration.geometry.shapes import (
    LINE_SHARE,
    METRES_BELOW_MM,
    Centerline,
    Mesh,
    Polyline,
    PrincipalFrame,
    diagonal_mm,
    principal_frame,
    require_cloud,
    require_millimetres,
    require_points,
    surface_frame,
)

__all__ = [
    "LINE_SHARE",
    "METRES_BELOW_MM",
    "Centerline",
    "Mesh",
    "Polyline",
    "PrincipalFrame",
    "diagonal_mm",
    "principal_frame",
    "require_cloud",
    "require_millimetres",
    "require_points",
    "surface_frame",
]
