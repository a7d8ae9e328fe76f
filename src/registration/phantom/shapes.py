"""Vessel shapes as swept elliptic sections along smooth lines, and the closed surface around their union.

Everything is in the ``ct`` frame (LPS, mm): x to the left, y to the back, z to the head. The skin lies in front, at
negative y, so a probe on it looks along +y.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64, Int
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from registration.errors import InputError
from registration.geometry.shapes import Mesh

SAMPLING_MM = 0.1
# Beyond this distance from the widest section the implicit function is constant.
FAR_MM = 2.0


@dataclass(frozen=True)
class VesselLine:
    """One unbranched vessel: a line with an elliptic section perpendicular to it.

    The ends are closed by half ellipsoids.

    Parameters
    ----------
    points_mm : ndarray, shape (m, 3)
        Points in order along the vessel in mm.
    radius_mm : ndarray, shape (m,)
        Half the section's front-to-back size in mm.
    widening : ndarray, shape (m,)
        Ratio of the section's left-to-right to its front-to-back size; 1 is a circle.

    Raises
    ------
    InputError
        If a radius or a widening is not positive.
    """

    points_mm: Float64[np.ndarray, "m 3"]
    radius_mm: Float64[np.ndarray, " m"]
    widening: Float64[np.ndarray, " m"]

    def __post_init__(self) -> None:
        if not (self.radius_mm > 0).all() or not (self.widening > 0).all():
            raise InputError("VesselLine: expected positive radii and widenings, received others")

    @property
    def tangents(self) -> Float64[np.ndarray, "m 3"]:
        """Unit directions along the line."""
        steps = np.gradient(self.points_mm, axis=0)
        return steps / np.linalg.norm(steps, axis=1, keepdims=True)

    @property
    def length_mm(self) -> float:
        """Arc length of the line in mm."""
        return float(np.linalg.norm(np.diff(self.points_mm, axis=0), axis=1).sum())


def spline_line(
    controls_mm: Float[np.ndarray, "c 3"],
    radii_mm: Float[np.ndarray, " c"],
    widenings: Float[np.ndarray, " c"] | float = 1.0,
) -> VesselLine:
    """Draw a natural cubic spline through control points and sample it evenly, with radius and widening.

    Parameters
    ----------
    controls_mm : ndarray, shape (c, 3)
        Control points in mm, at least two.
    radii_mm : ndarray, shape (c,)
        Radius at each control point in mm.
    widenings : ndarray, shape (c,) or float, optional
        Ratio of width to depth at each control point, or one for all.

    Returns
    -------
    VesselLine
        The line, sampled every 0.1 mm.

    Raises
    ------
    InputError
        If there are fewer than two control points.
    """
    controls_mm = np.asarray(controls_mm, dtype=np.float64)
    if len(controls_mm) < 2:
        raise InputError(f"controls_mm: expected at least two points, received {len(controls_mm)}")
    values = np.column_stack(
        [controls_mm, np.asarray(radii_mm), np.broadcast_to(np.asarray(widenings), len(controls_mm))]
    )
    chord_mm = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(controls_mm, axis=0), axis=1))])
    curve = CubicSpline(chord_mm, values, bc_type="natural")
    dense = np.linspace(0.0, chord_mm[-1], 2000)
    arc_mm = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve(dense)[:, :3], axis=0), axis=1))])
    count = max(2, round(arc_mm[-1] / SAMPLING_MM) + 1)
    even = curve(np.interp(np.linspace(0.0, arc_mm[-1], count), arc_mm, dense))
    return VesselLine(points_mm=even[:, :3].copy(), radius_mm=even[:, 3].copy(), widening=even[:, 4].copy())


def implicit_mm(line: VesselLine, points_mm: Float[np.ndarray, "n 3"]) -> Float64[np.ndarray, " n"]:
    """Evaluate a function that is negative inside the vessel and zero on its surface.

    Parameters
    ----------
    line : VesselLine
        Vessel.
    points_mm : ndarray, shape (n, 3)
        Points in mm.

    Returns
    -------
    ndarray, shape (n,)
        Value in mm: the exact distance where sections are circular, capped at 2 mm far outside.
    """
    far_mm = float((line.radius_mm * np.maximum(1.0, line.widening)).max()) + FAR_MM
    found = cKDTree(line.points_mm).query(points_mm, distance_upper_bound=far_mm)
    apart_mm, nearest = np.asarray(found[0]), np.asarray(found[1])
    field_mm = np.full(len(points_mm), FAR_MM)
    close = np.isfinite(apart_mm)
    field_mm[close] = _section_mm(line, points_mm[close], nearest[close])
    return field_mm


def _section_mm(
    line: VesselLine, points_mm: Float[np.ndarray, "n 3"], nearest: Int[np.ndarray, " n"]
) -> Float64[np.ndarray, " n"]:
    """The implicit function in the cross-section at each point's nearest place on the line."""
    tangent = line.tangents[nearest]
    offset_mm = points_mm - line.points_mm[nearest]
    sideways = np.array([1.0, 0.0, 0.0]) - tangent[:, :1] * tangent
    sideways /= np.linalg.norm(sideways, axis=1, keepdims=True)
    along_mm = np.einsum("ni,ni->n", offset_mm, tangent)
    side_mm = np.einsum("ni,ni->n", offset_mm, sideways)
    front_mm2 = np.einsum("ni,ni->n", offset_mm, offset_mm) - along_mm**2 - side_mm**2
    radius_mm, widening = line.radius_mm[nearest], line.widening[nearest]
    smaller_mm = radius_mm * np.minimum(1.0, widening)
    squared = (
        (side_mm / (radius_mm * widening)) ** 2 + front_mm2 / radius_mm**2 + (along_mm / smaller_mm) ** 2
    )
    return (np.sqrt(np.maximum(squared, 0.0)) - 1.0) * smaller_mm


def surround(lines: tuple[VesselLine, ...], pitch_mm: float = 0.4, blend_mm: float = 0.6) -> Mesh:
    """Build the closed surface around the union of vessels by marching cubes.

    Parameters
    ----------
    lines : tuple of VesselLine
        Vessels to unite.
    pitch_mm : float, optional
        Side of the grid cells in mm.
    blend_mm : float, optional
        Width in mm of the rounded crotch where vessels meet (the polynomial smooth minimum).

    Returns
    -------
    Mesh
        Closed surface, triangles facing outwards.

    References
    ----------
    T. Lewiner et al., J. Graph. Tools 8(2), 2003.
    """
    from skimage.measure import marching_cubes

    everything_mm = np.concatenate([line.points_mm for line in lines])
    margin_mm = max(float((line.radius_mm * np.maximum(1.0, line.widening)).max()) for line in lines) + 1.5
    low_mm = everything_mm.min(axis=0) - margin_mm
    counts = np.ceil((everything_mm.max(axis=0) + margin_mm - low_mm) / pitch_mm).astype(int) + 1
    axes_mm = [low_mm[axis] + pitch_mm * np.arange(counts[axis]) for axis in range(3)]
    grid_mm = np.stack(np.meshgrid(*axes_mm, indexing="ij"), axis=-1).reshape(-1, 3)
    field_mm = implicit_mm(lines[0], grid_mm)
    for line in lines[1:]:
        field_mm = _smooth_minimum(field_mm, implicit_mm(line, grid_mm), blend_mm)
    vertices, triangles, _, _ = marching_cubes(
        field_mm.reshape(counts), level=0.0, spacing=(pitch_mm,) * 3, gradient_direction="ascent"
    )
    return outward(Mesh(vertices.astype(np.float64) + low_mm, triangles.astype(np.int64)))


def outward(mesh: Mesh) -> Mesh:
    """Orient the triangles of a closed surface outwards.

    Parameters
    ----------
    mesh : Mesh
        Closed, consistently oriented surface.

    Returns
    -------
    Mesh
        The mesh, its triangles flipped if the enclosed volume was negative.
    """
    if signed_volume_mm3(mesh) >= 0:
        return mesh
    return Mesh(mesh.vertices_mm, np.ascontiguousarray(mesh.triangles[:, ::-1]))


def signed_volume_mm3(mesh: Mesh) -> float:
    """Compute the enclosed volume by the divergence theorem.

    Parameters
    ----------
    mesh : Mesh
        Closed surface in mm.

    Returns
    -------
    float
        Volume in mm3; negative when the triangles face inwards.
    """
    a, b, c = np.moveaxis(mesh.corners_mm - mesh.vertices_mm.mean(axis=0), 1, 0)
    return float(np.einsum("ti,ti->t", a, np.cross(b, c)).sum() / 6.0)


def _smooth_minimum(
    first_mm: Float[np.ndarray, " n"], second_mm: Float[np.ndarray, " n"], blend_mm: float
) -> Float[np.ndarray, " n"]:
    if blend_mm <= 0:
        return np.minimum(first_mm, second_mm)
    overlap = np.maximum(blend_mm - np.abs(first_mm - second_mm), 0.0) / blend_mm
    return np.minimum(first_mm, second_mm) - overlap**2 * blend_mm / 4.0
