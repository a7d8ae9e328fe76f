"""Displacements of tissue that are not the simulator's own bend: a local indentation and a rough random field.

A method that assumes a smooth Gaussian displacement must not be judged on such displacements alone. These two have
other forms: a dent of compact support, and a sum of waves whose covariance is Matern's of order 3/2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64

from registration import transforms
from registration.geometry.rigid_fit import kabsch
from registration.phantom.displacement import body_around, scaled_to

# The dent reaches this far, and is deepest so far beside the vessel's centerline.
REACH_MM, BESIDE_MM = 24.0, 5.0
FIELD_LENGTH_MM, WAVES = 25.0, 64
# No wave is shorter: it would fold the tissue over itself.
SHORTEST_WAVE_MM = 12.0


@dataclass(frozen=True)
class Indentation:
    """Local dent: one push that fades to nothing within a reach, by Wendland's function of order 2.

    Parameters
    ----------
    centre_mm : ndarray, shape (3,)
        Centre of the dent in the bed frame in mm.
    push_mm : ndarray, shape (3,)
        Displacement at the centre in mm.
    reach_mm : float
        Distance in mm from which on nothing is displaced.

    References
    ----------
    H. Wendland, Adv. Comput. Math. 4, 1995.
    """

    centre_mm: Float64[np.ndarray, "3"]
    push_mm: Float64[np.ndarray, "3"]
    reach_mm: float

    def __call__(self, points_mm: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Compute where material points lie at the time of the sweep.

        Parameters
        ----------
        points_mm : ndarray, shape (n, 3)
            Material points in the bed frame in mm.

        Returns
        -------
        ndarray, shape (n, 3)
            Displaced points in mm, in the precision of the input.
        """
        away = np.minimum(np.linalg.norm(points_mm - self.centre_mm, axis=1) / self.reach_mm, 1.0)
        share = (1.0 - away) ** 4 * (4.0 * away + 1.0)
        return np.asarray(points_mm + share[:, None] * self.push_mm, dtype=points_mm.dtype)


@dataclass(frozen=True)
class RandomField:
    """Sum of plane waves, followed by a rigid motion that removes its rigid part.

    Parameters
    ----------
    waves : ndarray, shape (k, 3)
        Wave vectors in rad/mm.
    phases : ndarray, shape (k,)
        Phases in rad.
    weights_mm : ndarray, shape (k, 3)
        Displacement by each wave in mm.
    still_T_moved : ndarray, shape (4, 4)
        Rigid transform that brings the displaced vessel back over itself.
    """

    waves: Float64[np.ndarray, "k 3"]
    phases: Float64[np.ndarray, " k"]
    weights_mm: Float64[np.ndarray, "k 3"]
    still_T_moved: Float64[np.ndarray, "4 4"]

    def __call__(self, points_mm: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Compute where material points lie at the time of the sweep.

        Parameters
        ----------
        points_mm : ndarray, shape (n, 3)
            Material points in the bed frame in mm.

        Returns
        -------
        ndarray, shape (n, 3)
            Displaced points in mm, in the precision of the input.
        """
        moved_mm = points_mm + np.cos(points_mm @ self.waves.T + self.phases) @ self.weights_mm
        return np.asarray(transforms.apply(self.still_T_moved, moved_mm), dtype=points_mm.dtype)


def draw_indentation(
    guide_mm: Float64[np.ndarray, "g 3"], size_mm: float, rng: np.random.Generator
) -> Indentation:
    """Draw a dent beside the middle four fifths of a vessel, towards it.

    Parameters
    ----------
    guide_mm : ndarray, shape (g, 3)
        Points along the vessel in the bed frame in mm.
    size_mm : float
        Displacement at the centre of the dent in mm.
    rng : numpy.random.Generator
        Random stream of the dent.

    Returns
    -------
    Indentation
        The dent.
    """
    place = round(rng.uniform(0.1, 0.9) * (len(guide_mm) - 1))
    along = guide_mm[min(place + 1, len(guide_mm) - 1)] - guide_mm[max(place - 1, 0)]
    across = np.cross(along, rng.standard_normal(3))
    across /= np.linalg.norm(across)
    return Indentation(guide_mm[place] - BESIDE_MM * across, size_mm * across, REACH_MM)


def draw_field(guide_mm: Float64[np.ndarray, "g 3"], size_mm: float, rng: np.random.Generator) -> RandomField:
    """Draw a random field of Matern's covariance of order 3/2, with features by random waves.

    Parameters
    ----------
    guide_mm : ndarray, shape (g, 3)
        Points along the vessel in the bed frame in mm.
    size_mm : float
        Largest displacement of these points in mm, once the rigid part of the field is taken out.
    rng : numpy.random.Generator
        Random stream of the field.

    Returns
    -------
    RandomField
        The field.

    References
    ----------
    A. Rahimi and B. Recht, NIPS 20, 2007.
    """
    # The spectrum of Matern's covariance of order 3/2 is Student's distribution with 3 degrees of freedom.
    waves = rng.standard_normal((WAVES, 3)) * np.sqrt(3.0 / rng.chisquare(3.0, (WAVES, 1))) / FIELD_LENGTH_MM
    length = np.linalg.norm(waves, axis=1, keepdims=True)
    waves *= np.minimum(1.0, 2.0 * np.pi / (SHORTEST_WAVE_MM * length))
    phases, weights = rng.uniform(0.0, 2.0 * np.pi, WAVES), rng.standard_normal((WAVES, 3))
    body_mm = body_around(guide_mm)

    def scaled(factor_mm: float) -> RandomField:
        raw = RandomField(waves, phases, factor_mm * weights, np.eye(4))
        return RandomField(waves, phases, factor_mm * weights, kabsch(raw(body_mm), body_mm))

    return scaled_to(scaled, guide_mm, size_mm, float(size_mm / np.sqrt(WAVES)))
