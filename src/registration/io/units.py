"""The unit of a vessel model's file, which hardly any file states: set, or suspected from the vessel's size."""

from __future__ import annotations

import math

import numpy as np

from registration.errors import InputError
from registration.geometry.mesh_quality import enclosed_volume_mm3
from registration.geometry.shapes import Mesh, diagonal_mm

MM_PER_UNIT = {"mm": 1.0, "cm": 10.0, "m": 1000.0}
# What a model of a vessel for an endovascular intervention measures. The radius of the arteries and veins that are
# entered and seen by ultrasound is 1 mm (distal radial artery) to 60 mm (giant aneurysm); the model is longer than
# 10 mm and no longer than a patient.
RADIUS_MM = (1.0, 60.0)
DIAGONAL_MM = (10.0, 2500.0)
USUAL_RADIUS_MM = 5.0


def typical_radius_mm(mesh: Mesh) -> float:
    """Compute twice the volume over the area of the wall, which is the radius of a tube.

    Parameters
    ----------
    mesh : Mesh
        Surface in mm.

    Returns
    -------
    float
        Radius in mm, 0 for a surface without inside.
    """
    area_mm2 = float(mesh.areas_mm2.sum())
    return 2 * abs(enclosed_volume_mm3(mesh)) / area_mm2 if area_mm2 > 0 else 0.0


def to_millimetres(mesh: Mesh, units: str | None, name: str = "input") -> Mesh:
    """Convert a mesh to millimetres.

    Parameters
    ----------
    mesh : Mesh
        Surface in the file's unit.
    units : {'mm', 'cm', 'm'} or None
        Unit; None takes the mesh as mm if it is of a vessel's size.
    name : str, optional
        Name of the file, for messages.

    Returns
    -------
    Mesh
        Surface in mm.

    Raises
    ------
    InputError
        If the unit is unknown, or without one the diagonal or the typical radius is no vessel's; the message
        names the unit that would make a vessel of it.

    Notes
    -----
    A wide vessel in centimetres looks like a narrow one in millimetres (radius 12 mm and 1.2 mm): no rule can
    tell these apart.
    """
    if units not in (None, *MM_PER_UNIT):
        raise InputError(f"units: expected one of {', '.join(MM_PER_UNIT)}, received {units!r}")
    if units is not None:
        return Mesh(MM_PER_UNIT[units] * mesh.vertices_mm, mesh.triangles)
    diagonal, radius = diagonal_mm(mesh.vertices_mm), typical_radius_mm(mesh)
    if _is_vessel(diagonal, radius):
        return mesh
    guess = suspected_unit(diagonal, radius)
    hint = (
        f"which looks like {guess}: pass units={guess} to convert it or units=mm to take it as it is"
        if guess
        else "which is no vessel's size in mm, cm or m: pass units=mm to take it as it is"
    )
    raise InputError(
        f"{name}: expected a vessel in millimetres, received one with a diagonal of {diagonal:.3g} and a typical "
        f"radius of {radius:.3g}, {hint}"
    )


def suspected_unit(diagonal: float, radius: float) -> str | None:
    """Find the unit in which a model of some size would be a vessel, nearest to the usual radius.

    Parameters
    ----------
    diagonal : float
        Diagonal of the bounding box in the file's unit.
    radius : float
        Typical radius in the file's unit.

    Returns
    -------
    str or None
        Unit, or None where none makes a vessel of it.
    """
    fitting = [
        unit
        for unit, scale in MM_PER_UNIT.items()
        if radius > 0 and _is_vessel(scale * diagonal, scale * radius)
    ]
    return min(
        fitting,
        key=lambda unit: abs(math.log(MM_PER_UNIT[unit] * radius / USUAL_RADIUS_MM)),
        default=None,
    )


def _is_vessel(diagonal_mm: float, radius_mm: float) -> bool:
    within = (RADIUS_MM[0] <= radius_mm <= RADIUS_MM[1], DIAGONAL_MM[0] <= diagonal_mm <= DIAGONAL_MM[1])
    return bool(np.all(within))
