"""An artery and a vein side by side, as the neck and the groin show them, for the built-in simulator.

Sizes: the common carotid measures 6 to 7 mm across in adults (Krejza et al., Stroke 37, 2006), the internal jugular
vein about twice that and flat; the common femoral artery 8 to 10 mm (Sandgren et al., J. Vasc. Surg. 29, 1999), the
common femoral vein about 12 mm (Fronek et al., J. Vasc. Surg. 33, 2001). The vein lies next to the artery, somewhat in
front of it in the neck and behind it in the groin. Under the probe both flatten alike: the simulator presses once.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from jaxtyping import Bool, Int64, UInt8

from experiments.errors import InputError
from registration.phantom.anatomy import Anatomy, from_lines
from registration.phantom.deformation import View
from registration.phantom.designed_shapes import SKIN_Y_MM
from registration.phantom.shapes import VesselLine, implicit_mm, spline_line
from registration.phantom.simulator import SweepSimulator
from registration.phantom.slicing import cut, rasterise

VEIN, ARTERY = 1, 2
HALF_LENGTH_MM = 42.0


@dataclass(frozen=True)
class District:
    """Ranges of the sizes in one part of the body.

    Parameters
    ----------
    artery_radius_mm : (float, float)
        Half the front-to-back size of the artery.
    vein_radius_mm : (float, float)
        Half the front-to-back size of the vein.
    vein_widening : (float, float)
        Width of the vein over its front-to-back size.
    vein_behind_mm : (float, float)
        Depth of the vein less that of the artery.
    """

    artery_radius_mm: tuple[float, float]
    vein_radius_mm: tuple[float, float]
    vein_widening: tuple[float, float]
    vein_behind_mm: tuple[float, float]


DISTRICTS = {
    "carotid": District((2.9, 3.6), (3.0, 4.2), (1.4, 1.8), (-3.0, -1.0)),
    "femoral": District((3.8, 5.0), (3.8, 5.0), (1.2, 1.5), (0.0, 2.5)),
}


def draw_pair(district: str, seed: int) -> tuple[VesselLine, VesselLine]:
    """Draw artery and vein of one anatomy; their lumens stay at least 1 mm apart, either may lie on the left.

    Parameters
    ----------
    district : {'carotid', 'femoral'}
        The part of the body.
    seed : int
        Seed of the anatomy.

    Returns
    -------
    (VesselLine, VesselLine)
        Artery and vein, in mm.

    Raises
    ------
    InputError
        If there is no such district.
    """
    if district not in DISTRICTS:
        raise InputError(f"district: expected one of {', '.join(DISTRICTS)}, received {district!r}")
    ranges, rng = DISTRICTS[district], np.random.default_rng([seed, 41, list(DISTRICTS).index(district)])
    artery_mm, vein_mm = rng.uniform(*ranges.artery_radius_mm), rng.uniform(*ranges.vein_radius_mm)
    widening, behind_mm = rng.uniform(*ranges.vein_widening), rng.uniform(*ranges.vein_behind_mm)
    apart_mm = artery_mm + widening * vein_mm + rng.uniform(2.5, 3.5)
    side = rng.choice([-1.0, 1.0])
    z_mm = np.linspace(-HALF_LENGTH_MM, HALF_LENGTH_MM, 6)
    # Both follow one course through the body, each with a little of its own.
    course_mm = np.column_stack([rng.uniform(-2.5, 2.5, 6), rng.uniform(-1.5, 1.5, 6), z_mm])
    own_mm = rng.uniform(-0.3, 0.3, (2, 6, 3)) * [1.0, 1.0, 0.0]
    deep_mm = rng.uniform(1.0, 4.0)
    artery = course_mm + own_mm[0] + [-0.5 * side * apart_mm, deep_mm, 0.0]
    vein = course_mm + own_mm[1] + [0.5 * side * apart_mm, deep_mm + behind_mm, 0.0]
    tapers = 1.0 + rng.uniform(-0.05, 0.05, (2, 1)) * z_mm / HALF_LENGTH_MM
    return (
        spline_line(artery, artery_mm * tapers[0]),
        spline_line(vein, vein_mm * tapers[1], np.full(6, widening)),
    )


@lru_cache(maxsize=4)
def pair_anatomy(district: str, seed: int) -> tuple[Anatomy, Bool[np.ndarray, " t"]]:
    """Build the anatomy around both vessels.

    Parameters
    ----------
    district : {'carotid', 'femoral'}
        The part of the body.
    seed : int
        Seed of the anatomy.

    Returns
    -------
    (Anatomy, ndarray of bool, shape (t,))
        The anatomy, and which triangles of its surface are the artery's.
    """
    artery, vein = draw_pair(district, seed)
    anatomy = from_lines((artery, vein), SKIN_Y_MM)
    vertices_mm = anatomy.surface.vertices_mm
    of_artery = implicit_mm(artery, vertices_mm) < implicit_mm(vein, vertices_mm)
    corners: Int64[np.ndarray, "t 3"] = anatomy.surface.triangles
    return anatomy, of_artery[corners[:, 0]]


@dataclass(frozen=True)
class PairSimulator(SweepSimulator):
    """One sweep over an artery and a vein; the mask of a frame holds labels: 0 background, 1 vein, 2 artery.

    Parameters
    ----------
    district : {'carotid', 'femoral'}
        The part of the body.
    """

    district: str

    @cached_property
    def anatomy(self) -> Anatomy:
        """Both vessels."""
        return pair_anatomy(self.district, self.settings.anatomy_seed)[0]

    def frame(
        self, frame: int, view: View
    ) -> tuple[UInt8[np.ndarray, "h w"], UInt8[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]:
        """Make one frame.

        Parameters
        ----------
        frame : int
            Its number, from 0.
        view : View
            Where the probe is, and how it presses.

        Returns
        -------
        (ndarray of uint8, ndarray of uint8, ndarray of bool)
            Picture, labels and hidden pixels, each of shape (h, w).
        """
        picture, shown, hidden = super().frame(frame, view)
        _, of_artery = pair_anatomy(self.district, self.settings.anatomy_seed)
        labels = np.where(shown, np.uint8(VEIN), np.uint8(0))
        labels[shown & self._mask(view, self.anatomy.surface.triangles[of_artery])] = ARTERY
        return picture, labels, hidden

    def _mask(self, view: View, triangles: Int64[np.ndarray, "t 3"]) -> Bool[np.ndarray, "h w"]:
        scanner, beams = self.settings.scanner, self.imager.beams
        shown_mm = beams.displayed(cut(view.pressed(self.bent_surface_mm), triangles))
        corner_mm = np.array([axis[0, 0] for axis in beams.pixel_places_mm])
        return rasterise((shown_mm - corner_mm) / scanner.pixel_mm, scanner.height_px, scanner.width_px)
