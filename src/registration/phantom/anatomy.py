"""What lies under the probe: one vessel tree, its surface, and the skin above it, in the ``ct`` frame."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from registration.errors import InputError
from registration.geometry import Centerline, Mesh, Polyline
from registration.phantom.designs import DESIGNS, SKIN_Y_MM
from registration.phantom.distance import DistanceGrid, distance_grid
from registration.phantom.shapes import VesselLine, surround


@dataclass(frozen=True)
class Anatomy:
    """A vessel with its exact centerline, undeformed: the truth that images are made from.

    ``surface`` is closed. ``centerline`` carries the largest inscribed radius. The skin is the plane
    ``y = skin_y_mm``; the probe looks along +y.
    """

    name: str
    surface: Mesh
    centerline: Centerline
    distance: DistanceGrid
    skin_y_mm: float


@lru_cache(maxsize=4)
def design(name: str) -> Anatomy:
    """One of the fixed designs by name: ``artificial``, ``vein`` or ``artery``."""
    if name not in DESIGNS:
        raise InputError(f"subset: expected one of {', '.join(DESIGNS)}, received {name!r}")
    return from_lines(name, DESIGNS[name](), SKIN_Y_MM)


def from_lines(name: str, lines: tuple[VesselLine, ...], skin_y_mm: float) -> Anatomy:
    """The anatomy around given vessel lines; the skin must lie in front of every wall."""
    surface = surround(lines)
    nearest_mm = float(surface.vertices_mm[:, 1].min())
    if nearest_mm <= skin_y_mm:
        raise InputError(
            f"skin_y_mm: expected the skin in front of the vessel (below {nearest_mm:.1f} mm), "
            f"received {skin_y_mm:g} mm"
        )
    centerline = Centerline(
        tuple(
            Polyline(line.points_mm[::5], (line.radius_mm * np.minimum(1.0, line.widening))[::5])
            for line in lines
        )
    )
    return Anatomy(name, surface, centerline, distance_grid(surface), skin_y_mm)
