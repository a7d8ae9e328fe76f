"""Vessels that are displaced in a known way: designed ones, random anatomies, and a real aorta from files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float64
from scipy.spatial import cKDTree

from registration.errors import InputError
from registration.geometry.shapes import Centerline, Mesh, Polyline, principal_frame
from registration.io.surfaces import read_centerline, read_surface
from registration.phantom.designed_shapes import DESIGNS
from registration.phantom.random_anatomy import draw_lines
from registration.phantom.shapes import VesselLine, surround

DESIGNED = ("artery", "vein")
# Seeds of test anatomies that no block of the frozen benchmark has.
RANDOM_SEEDS = range(1200, 1212)
# Files of the real aorta in its folder.
AORTA, AORTA_SURFACE, AORTA_LINE = "aorta", "aorta-surface-open-ends.stl", "aorta-centerline.vtp"
LINE_TARGETS = 60
# Besides those on the centerline, targets lie this share of the way to the wall.
TO_WALL = 0.5
# A dense line, every so many millimetres.
STEP_MM = 0.5


@dataclass(frozen=True)
class KnownVessel:
    """Wall and centerline of a vessel, both exact.

    Parameters
    ----------
    name : str
        Name of the vessel.
    surface : Mesh
        Wall in mm.
    centerline : Centerline
        Centerline with radii in the same frame in mm; the first line is the main one.
    """

    name: str
    surface: Mesh
    centerline: Centerline

    def targets_mm(self, rng: np.random.Generator) -> Float64[np.ndarray, "t 3"]:
        """Choose interior points: on the centerline at even arc length, and half way from each of these to the wall.

        Parameters
        ----------
        rng : numpy.random.Generator
            Random stream of the directions in which the wall lies.

        Returns
        -------
        ndarray, shape (t, 3)
            Points in mm.
        """
        on_line_mm = self.centerline.even_points(LINE_TARGETS)
        places_mm, tangents, radius_mm = self._dense
        nearest = cKDTree(places_mm).query(on_line_mm)[1]
        across = np.cross(tangents[nearest], rng.standard_normal(on_line_mm.shape))
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        return np.concatenate([on_line_mm, on_line_mm + TO_WALL * radius_mm[nearest, None] * across])

    def beside_line(self, points_mm: Float64[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Mark the points that lie beside the centerline and not beyond an end of it, where no sweep sees a wall.

        Parameters
        ----------
        points_mm : ndarray, shape (n, 3)
            Points of the wall in mm.

        Returns
        -------
        ndarray of bool, shape (n,)
            Marks.
        """
        places_mm, tangents, _ = self._dense
        nearest = cKDTree(places_mm).query(points_mm)[1]
        along_mm = np.einsum("nk,nk->n", points_mm - places_mm[nearest], tangents[nearest])
        # Beside a line the nearest place is level with a point, but for the step between places.
        return np.asarray(np.abs(along_mm) <= STEP_MM)

    def along_mm(self, points_mm: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, " n"]:
        """Compute coordinates along the longest axis of the vessel.

        Parameters
        ----------
        points_mm : ndarray, shape (n, 3)
            Points in mm.

        Returns
        -------
        ndarray, shape (n,)
            Coordinates in mm.
        """
        frame = principal_frame(self.surface.vertices_mm)
        return np.asarray((points_mm - frame.centre_mm) @ frame.axes[:, 0])

    @property
    def _dense(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Places along all lines, the direction and the radius at each."""
        places, tangents, radii = [], [], []
        for line in self.centerline.lines:
            arc_mm = np.linspace(0.0, line.length_mm, max(3, round(line.length_mm / STEP_MM) + 1))
            at_mm = line.at(arc_mm)
            steps = np.gradient(at_mm, axis=0)
            places.append(at_mm)
            tangents.append(steps / np.linalg.norm(steps, axis=1, keepdims=True))
            radii.append(np.interp(arc_mm, line.arc_mm, line.radius_mm))
        return np.concatenate(places), np.concatenate(tangents), np.concatenate(radii)


def known_vessel(name: str, aorta: Path | None = None) -> KnownVessel:
    """Make or read a vessel.

    Parameters
    ----------
    name : str
        ``aorta``, ``artery``, ``vein``, or ``random`` with the seed of an anatomy, as in ``random1200``.
    aorta : Path or None, optional
        Folder of the aorta's files; only the aorta needs it.

    Returns
    -------
    KnownVessel
        The vessel.

    Raises
    ------
    InputError
        If there is no such vessel, or the aorta's files are missing.
    """
    if name == AORTA:
        if aorta is None:
            raise InputError("aorta: expected the folder of its files, received none")
        surface = read_surface(aorta / AORTA_SURFACE)
        if not isinstance(surface, Mesh):
            raise InputError(f"{aorta / AORTA_SURFACE}: expected a mesh, received points alone")
        return KnownVessel(name, surface, read_centerline(aorta / AORTA_LINE))
    if name in DESIGNED:
        lines = DESIGNS[name]()
    elif name.removeprefix("random").isdigit() and name.startswith("random"):
        lines = draw_lines(int(name.removeprefix("random")))
    else:
        raise InputError(f"vessel: expected aorta, artery, vein or random<seed>, received {name!r}")
    return KnownVessel(name, surround(lines), Centerline(tuple(_polyline(line) for line in lines)))


def _polyline(line: VesselLine) -> Polyline:
    return Polyline(line.points_mm[::5], (line.radius_mm * np.minimum(1.0, line.widening))[::5])
