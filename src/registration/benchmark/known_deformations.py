"""Known smooth displacements of a vessel and the tissue around it: bending, dilation, indentation.

All three are functions of place, so that the displacement of any interior point is known, and none of them is drawn
from the prior of a method.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64

from registration.benchmark.tissue_displacement import draw_indentation
from registration.errors import InputError
from registration.geometry.shapes import principal_frame
from registration.phantom.displacement import Displacement

BENDING, DILATION, INDENTATION, NONE = "bending", "dilation", "indentation", "none"
DEFORMATIONS = (BENDING, DILATION, INDENTATION, NONE)
# A vessel widens by at most this share of its radius, over this distance from the middle of the widening.
WIDEST_SHARE, REACH_MM = 0.4, 30.0


@dataclass(frozen=True)
class Bending:
    """One period of a cosine across a vessel, along its length.

    Parameters
    ----------
    centre_mm : ndarray, shape (3,)
        Middle of the vessel in mm.
    along, across : ndarray, shape (3,)
        Unit vectors along the vessel and of the displacement.
    half_length_mm : float
        Half the length of the vessel in mm.
    size_mm : float
        Displacement in the middle in mm; that at the ends is its opposite.
    """

    centre_mm: Float64[np.ndarray, "3"]
    along: Float64[np.ndarray, "3"]
    across: Float64[np.ndarray, "3"]
    half_length_mm: float
    size_mm: float

    def __call__(self, points_mm: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Compute where material points lie after the displacement.

        Parameters
        ----------
        points_mm : ndarray, shape (n, 3)
            Material points in mm.

        Returns
        -------
        ndarray, shape (n, 3)
            Displaced points in mm.
        """
        phase = np.pi * ((points_mm - self.centre_mm) @ self.along) / self.half_length_mm
        return np.asarray(points_mm + self.size_mm * np.outer(np.cos(phase), self.across))


@dataclass(frozen=True)
class Dilation:
    """Local widening: points move away from an axis, in proportion to their distance from it near its middle.

    The proportion fades to nothing within ``REACH_MM`` by Wendland's function of order 2.

    Parameters
    ----------
    centre_mm : ndarray, shape (3,)
        Middle of the widening in mm.
    axis : ndarray, shape (3,)
        Unit vector along the vessel there.
    share : float
        Displacement over distance from the axis, in the middle.

    References
    ----------
    H. Wendland, Adv. Comput. Math. 4, 1995.
    """

    centre_mm: Float64[np.ndarray, "3"]
    axis: Float64[np.ndarray, "3"]
    share: float

    def __call__(self, points_mm: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Compute where material points lie after the displacement.

        Parameters
        ----------
        points_mm : ndarray, shape (n, 3)
            Material points in mm.

        Returns
        -------
        ndarray, shape (n, 3)
            Displaced points in mm.
        """
        away_mm = points_mm - self.centre_mm
        outwards_mm = away_mm - np.outer(away_mm @ self.axis, self.axis)
        near = np.minimum(np.linalg.norm(away_mm, axis=1) / REACH_MM, 1.0)
        return np.asarray(points_mm + (self.share * _wendland(near))[:, None] * outwards_mm)


def draw_known(
    name: str,
    line_mm: Float64[np.ndarray, "g 3"],
    radius_mm: Float64[np.ndarray, " g"],
    wall_mm: Float64[np.ndarray, "n 3"],
    size_mm: float,
    rng: np.random.Generator,
) -> Displacement:
    """Draw where on a vessel, and which way, it is displaced.

    Parameters
    ----------
    name : str
        ``bending``, ``dilation``, ``indentation`` or ``none``.
    line_mm : ndarray, shape (g, 3)
        Points in order along the vessel's main line in mm.
    radius_mm : ndarray, shape (g,)
        Radius of the vessel there in mm.
    wall_mm : ndarray, shape (n, 3)
        Points of its wall in mm.
    size_mm : float
        Size in mm: the displacement in the middle of a bend and of an indentation, the growth of the radius in the
        middle of a dilation (at most ``WIDEST_SHARE`` of the radius).
    rng : numpy.random.Generator
        Random stream of the draw.

    Returns
    -------
    callable
        Takes points in mm, shape (n, 3), to where they lie after the displacement.

    Raises
    ------
    InputError
        If there is no such deformation.
    """
    if name == NONE:
        return np.copy
    if name == BENDING:
        return _bending(wall_mm, size_mm, rng)
    if name == INDENTATION:
        return draw_indentation(line_mm, size_mm, rng)
    if name != DILATION:
        raise InputError(f"deformation: expected one of {', '.join(DEFORMATIONS)}, received {name!r}")
    place = round(rng.uniform(0.25, 0.75) * (len(line_mm) - 1))
    along = line_mm[min(place + 1, len(line_mm) - 1)] - line_mm[max(place - 1, 0)]
    wide_mm = float(radius_mm[place])
    growth_mm = min(size_mm, WIDEST_SHARE * wide_mm)
    share = growth_mm / (wide_mm * float(_wendland(np.array(wide_mm / REACH_MM))))
    return Dilation(line_mm[place], along / np.linalg.norm(along), share)


def _bending(wall_mm: np.ndarray, size_mm: float, rng: np.random.Generator) -> Bending:
    frame = principal_frame(wall_mm)
    along_mm = (wall_mm - frame.centre_mm) @ frame.axes[:, 0]
    low_mm, high_mm = float(along_mm.min()), float(along_mm.max())
    turn = rng.uniform(0.0, 2.0 * np.pi)
    across = np.cos(turn) * frame.axes[:, 1] + np.sin(turn) * frame.axes[:, 2]
    middle_mm = frame.centre_mm + 0.5 * (low_mm + high_mm) * frame.axes[:, 0]
    return Bending(middle_mm, frame.axes[:, 0].copy(), across, 0.5 * (high_mm - low_mm), size_mm)


def _wendland(share: np.ndarray) -> np.ndarray:
    return np.asarray((1.0 - share) ** 4 * (4.0 * share + 1.0))
