"""Walls rough with noise, smoothed before a vessel's middle is looked for."""

from __future__ import annotations

import numpy as np

from registration.centerline.medial_axis import mean_radius_mm
from registration.errors import InputError
from registration.geometry.mesh_topology import borders, with_caps
from registration.geometry.shapes import Mesh
from registration.metrics.surface_distance import SurfaceDistance
from registration.reconstruction.taubin import TaubinSmoothing

# Iterations that tell a rough wall, and those that then take off what is left of noise as large as the triangles.
TELLING, CLEANING = 10, 60
# Of a normal distribution's absolute values.
DEVIATION_PER_MEDIAN = 1.4826


def smooth_if_rough(mesh: Mesh, rough_radii: float) -> Mesh:
    """Smooth a vessel's wall that is rougher than ``rough_radii`` of the vessel's radius; any other stays as it is.

    Roughness is the distance of the vertices from the surface that a little of Taubin's filter (SIGGRAPH 1995) leaves,
    which takes off what varies from triangle to triangle and keeps the volume; as a standard deviation, by way of the
    median, so that the rim of a cap is no roughness. It is judged against the radius of the smoothed vessel: noise
    multiplies the area of a wall. A mesh whose volume the filter would change is no rough one, but one whose triangles
    are as large as the vessel is wide: it stays too.
    """
    if not len(mesh.triangles):
        return mesh
    smooth = _smoothed(mesh, TELLING)
    if smooth is None:
        return mesh
    try:
        radius_mm = mean_radius_mm(with_caps(smooth, borders(smooth)))
    except InputError:
        return mesh
    moved_mm = SurfaceDistance(smooth)(mesh.vertices_mm)
    if DEVIATION_PER_MEDIAN * float(np.median(moved_mm)) <= rough_radii * radius_mm:
        return mesh
    return _smoothed(smooth, CLEANING) or smooth


def _smoothed(mesh: Mesh, iterations: int) -> Mesh | None:
    """The mesh smoothed, or None where that would change the vessel."""
    try:
        return TaubinSmoothing(iterations)(mesh).mesh
    except InputError:
        return None
