"""Smoothing of noisy vessel walls before their centerline is extracted."""

from __future__ import annotations

import numpy as np

from registration.centerline.medial_axis import mean_radius_mm
from registration.errors import InputError
from registration.geometry.mesh_topology import borders, with_caps
from registration.geometry.shapes import Mesh
from registration.metrics.surface_distance import SurfaceDistance
from registration.reconstruction.taubin import TaubinSmoothing

# Iterations of smoothing to detect a rough wall, and those to remove noise as large as the triangles.
DETECTION_ITERATIONS, CLEANING_ITERATIONS = 10, 60
# Standard deviation of a normal distribution over the median of its absolute values.
DEVIATION_PER_MEDIAN = 1.4826


def smooth_if_rough(mesh: Mesh, rough_radii: float) -> Mesh:
    """Smooth a vessel wall if it is rougher than a limit; leave any other unchanged.

    Parameters
    ----------
    mesh : Mesh
        Vessel wall.
    rough_radii : float
        Roughness, in radii of the vessel, from which on the wall is smoothed.

    Returns
    -------
    Mesh
        The smoothed wall, or ``mesh`` itself.

    Notes
    -----
    Roughness is the distance of the vertices from the surface after a few iterations of Taubin's filter
    (SIGGRAPH 1995), which removes what varies from triangle to triangle and keeps the volume; as a robust
    standard deviation, by way of the median, so that the rim of a cap is no roughness. It is compared with
    the radius of the smoothed vessel, since noise multiplies the area of a wall. A mesh whose volume the
    filter would change has triangles as large as the vessel is wide, and is left unchanged too.
    """
    if not len(mesh.triangles):
        return mesh
    smooth = _smoothed(mesh, DETECTION_ITERATIONS)
    if smooth is None:
        return mesh
    try:
        radius_mm = mean_radius_mm(with_caps(smooth, borders(smooth)))
    except InputError:
        return mesh
    moved_mm = SurfaceDistance(smooth)(mesh.vertices_mm)
    if DEVIATION_PER_MEDIAN * float(np.median(moved_mm)) <= rough_radii * radius_mm:
        return mesh
    return _smoothed(smooth, CLEANING_ITERATIONS) or smooth


def _smoothed(mesh: Mesh, iterations: int) -> Mesh | None:
    """The mesh smoothed, or None where that would change the vessel."""
    try:
        return TaubinSmoothing(iterations)(mesh).mesh
    except InputError:
        return None
