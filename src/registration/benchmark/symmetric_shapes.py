"""Vessels with a symmetry, of which more than one pose is right: what a method must not be sure of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from registration.benchmark.symmetry import Screw, Symmetry, half_turn
from registration.phantom.shapes import SAMPLING_MM, VesselLine

HALF_LENGTH_MM = 42.0
RADIUS_MM = 4.0
ARC_RADIUS_MM, ARC_HALF_DEG = 45.0, 52.0
HELIX_RADIUS_MM, HELIX_PITCH_MM = 8.0, 80.0
ALONG, AROUND = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
ORIGIN_MM, ARC_CENTRE_MM = np.zeros(3), np.array([0.0, ARC_RADIUS_MM, 0.0])
ROLL = Screw(ORIGIN_MM, ALONG, 360.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True)
class SymmetricShape:
    """Vessel around ``lines`` along z, with half spheres for ends, that its ``symmetry`` maps onto itself.

    Parameters
    ----------
    lines : tuple of VesselLine
        Lines of the vessel in mm.
    symmetry : Symmetry
        Motions that leave it as it is, apart from slides.
    slide : Screw or None, optional
        Motion by s mm along a vessel that looks the same all the way; how far it may go depends on what was
        swept. None where there is no such motion.
    along_mm : callable or None, optional
        Function that gives the position of points (n, 3) along the vessel in mm; None without ``slide``.
    """

    lines: tuple[VesselLine, ...]
    symmetry: Symmetry
    slide: Screw | None = None
    along_mm: Callable[[np.ndarray], np.ndarray] | None = None

    def symmetry_of(
        self, moving_mm: Float64[np.ndarray, "m 3"], fixed_mm: Float64[np.ndarray, "n 3"]
    ) -> Symmetry:
        """Compute the symmetry of a case: slides reach as far as the swept part stays within the model.

        Parameters
        ----------
        moving_mm : ndarray, shape (m, 3)
            Moving points in their true place, in the fixed frame in mm.
        fixed_mm : ndarray, shape (n, 3)
            Points of the model in mm.

        Returns
        -------
        Symmetry
            Symmetry of the shape and the limited slide.
        """
        if self.slide is None or self.along_mm is None:
            return self.symmetry
        there_mm, here_mm = self.along_mm(fixed_mm), self.along_mm(moving_mm)
        low, high = min(there_mm.min() - here_mm.min(), 0.0), max(there_mm.max() - here_mm.max(), 0.0)
        screw = self.slide
        limited = Screw(
            screw.point_mm, screw.direction, screw.turn_deg, screw.shift_mm, float(low), float(high)
        )
        return Symmetry((*self.symmetry.screws, limited), self.symmetry.flips)


def straight() -> SymmetricShape:
    """Make a straight tube.

    Returns
    -------
    SymmetricShape
        The tube, with roll, half turn, and slide wherever there is room.
    """
    line = _line(np.outer(_places_mm(), ALONG), np.full(len(_places_mm()), RADIUS_MM))
    slide = Screw(ORIGIN_MM, ALONG, 0.0, 1.0, 0.0, 0.0)
    return SymmetricShape(
        (line,), Symmetry((ROLL,), (half_turn(ORIGIN_MM, AROUND),)), slide, lambda points_mm: points_mm[:, 2]
    )


def arc() -> SymmetricShape:
    """Make a piece of a ring of constant curvature.

    Returns
    -------
    SymmetricShape
        The piece, with half turn, and slide along the ring wherever there is room.
    """
    turn = np.deg2rad(np.linspace(-ARC_HALF_DEG, ARC_HALF_DEG, len(_places_mm())))
    points_mm = ARC_RADIUS_MM * np.stack([np.zeros_like(turn), 1 - np.cos(turn), np.sin(turn)], axis=1)
    slide = Screw(ARC_CENTRE_MM, AROUND, float(np.rad2deg(1 / ARC_RADIUS_MM)), 0.0, 0.0, 0.0)

    def along_mm(points_mm: np.ndarray) -> np.ndarray:
        away_mm = points_mm - ARC_CENTRE_MM
        return np.asarray(ARC_RADIUS_MM * np.arctan2(away_mm[:, 2], -away_mm[:, 1]))

    # A turn about x takes -y to -z: with it one slides backwards.
    back = Screw(ARC_CENTRE_MM, -AROUND, slide.turn_deg, 0.0, 0.0, 0.0)
    line = _line(points_mm, np.full(len(points_mm), RADIUS_MM))
    return SymmetricShape(
        (line,), Symmetry((), (half_turn(ORIGIN_MM, np.array([0.0, 1.0, 0.0])),)), back, along_mm
    )


def helix() -> SymmetricShape:
    """Make a helix of constant curvature and torsion.

    Returns
    -------
    SymmetricShape
        The helix, with half turn, and its screw motion wherever there is room.
    """
    z_mm = _places_mm()
    turn = 2 * np.pi * z_mm / HELIX_PITCH_MM
    points_mm = np.stack([HELIX_RADIUS_MM * np.cos(turn), HELIX_RADIUS_MM * np.sin(turn), z_mm], axis=1)
    slide = Screw(ORIGIN_MM, ALONG, 360.0 / HELIX_PITCH_MM, 1.0, 0.0, 0.0)
    line = _line(points_mm, np.full(len(points_mm), RADIUS_MM))
    return SymmetricShape(
        (line,), Symmetry((), (half_turn(ORIGIN_MM, AROUND),)), slide, lambda points_mm: points_mm[:, 2]
    )


def bulge() -> SymmetricShape:
    """Make a straight tube with a round bulge in its middle.

    Returns
    -------
    SymmetricShape
        The tube, with roll and half turn.
    """
    z_mm = _places_mm()
    radius_mm = 3.5 + 3.0 * np.exp(-0.5 * (z_mm / 7.0) ** 2)
    return SymmetricShape(
        (_line(np.outer(z_mm, ALONG), radius_mm),), Symmetry((ROLL,), (half_turn(ORIGIN_MM, AROUND),))
    )


def cone() -> SymmetricShape:
    """Make a straight tube that narrows.

    Returns
    -------
    SymmetricShape
        The tube, with roll.
    """
    z_mm = _places_mm()
    return SymmetricShape(
        (_line(np.outer(z_mm, ALONG), 4.5 - 2.0 * z_mm / HALF_LENGTH_MM),), Symmetry((ROLL,))
    )


def fork() -> SymmetricShape:
    """Make a trunk with two branches that bend to opposite sides.

    Returns
    -------
    SymmetricShape
        The fork, with half a turn about the trunk and nothing else.
    """
    share = np.linspace(0.0, 1.0, len(_places_mm()) // 2)
    trunk = _line(np.outer(-HALF_LENGTH_MM * (1 - share), ALONG), np.full(len(share), 4.0))
    branches = [
        _line(
            np.stack([side * 11 * share, side * 6 * share**2, HALF_LENGTH_MM * share], axis=1),
            np.full(len(share), 2.8),
        )
        for side in (1.0, -1.0)
    ]
    return SymmetricShape((trunk, *branches), Symmetry((), (half_turn(ORIGIN_MM, ALONG),)))


SHAPES: dict[str, tuple[Callable[[], SymmetricShape], tuple[str, ...]]] = {
    "straight": (straight, ("whole", "piece60_middle", "piece40_end", "outliers")),
    "arc": (arc, ("whole", "piece60_middle", "piece40_end", "missing")),
    "helix": (helix, ("whole", "piece60_middle", "piece40_end")),
    "bulge": (bulge, ("whole", "missing")),
    "cone": (cone, ("whole", "piece60_middle")),
    "fork": (fork, ("whole", "outliers", "missing")),
}


def _places_mm() -> np.ndarray:
    return np.linspace(-HALF_LENGTH_MM, HALF_LENGTH_MM, round(2 * HALF_LENGTH_MM / SAMPLING_MM) + 1)


def _line(points_mm: np.ndarray, radius_mm: np.ndarray) -> VesselLine:
    return VesselLine(points_mm=points_mm, radius_mm=radius_mm, widening=np.ones(len(points_mm)))
