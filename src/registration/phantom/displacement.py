"""Displacements of tissue in closed form: a smooth bend of the body, and the push of the probe."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeVar, runtime_checkable

import numpy as np
from jaxtyping import Float, Float64
from scipy.spatial.transform import Rotation

from registration import transforms

INVERSE_STEPS = 8
# How far the tissue reaches around the vessel whose rigid motion is taken out of a bend.
BODY_MM = 15.0


@runtime_checkable
class Displacement(Protocol):
    """Field that takes material points to where they lie at the time of the sweep, both in the bed frame."""

    def __call__(self, points_mm: Float[np.ndarray, "n 3"], /) -> Float[np.ndarray, "n 3"]:
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
        ...


Scaled = TypeVar("Scaled", bound=Displacement)


@dataclass(frozen=True)
class Bend:
    """Sum of Gaussian bumps, followed by a rigid motion that removes its rigid part.

    Parameters
    ----------
    centres_mm : ndarray, shape (k, 3)
        Centres of the bumps in the bed frame in mm.
    weights_mm : ndarray, shape (k, 3)
        Displacement at each centre in mm.
    length_mm : float
        Standard deviation of the bumps in mm.
    still_T_bent : ndarray, shape (4, 4)
        Rigid transform that brings the bent vessel back over itself.
    """

    centres_mm: Float64[np.ndarray, "k 3"]
    weights_mm: Float64[np.ndarray, "k 3"]
    length_mm: float
    still_T_bent: Float64[np.ndarray, "4 4"]

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
        kind = points_mm.dtype
        # |p - c|^2 is spread out into products of matrices, which are far faster than a loop over the bumps; counted
        # from the middle of the bumps and in their length, so that single precision loses nothing that matters.
        middle_mm = self.centres_mm.mean(axis=0)
        centres = ((self.centres_mm - middle_mm) / self.length_mm).astype(kind)
        points = (points_mm - middle_mm.astype(kind)) * kind.type(1.0 / self.length_mm)
        x, y, z = points.T
        exponent = points @ centres.T
        exponent -= kind.type(0.5) * (x * x + y * y + z * z)[:, None]
        exponent -= kind.type(0.5) * (centres * centres).sum(axis=1)
        # Far from a bump the exponential of a single would be a denormal number, which is many times slower.
        bumps = np.exp(np.maximum(exponent, kind.type(-80.0), out=exponent), out=exponent)
        bent = points_mm + bumps @ self.weights_mm.astype(kind)
        rigid = self.still_T_bent.astype(kind)
        return np.asarray(bent @ rigid[:3, :3].T + rigid[:3, 3])


def draw_bend(
    guide_mm: Float64[np.ndarray, "g 3"], max_mm: float, length_mm: float, rng: np.random.Generator
) -> Bend | None:
    """Draw a random bend.

    Parameters
    ----------
    guide_mm : ndarray, shape (g, 3)
        Points along the vessel in the bed frame in mm.
    max_mm : float
        Largest displacement of these points in mm.
    length_mm : float
        Length over which the field varies in mm.
    rng : numpy.random.Generator
        Random stream of the bend.

    Returns
    -------
    Bend or None
        The bend; None for a displacement of 0.
    """
    if max_mm == 0:
        return None
    chosen = np.linspace(0, len(guide_mm) - 1, 5).round().astype(int)
    centres_mm = guide_mm[chosen] + rng.normal(0.0, 8.0, (5, 3))
    direction = rng.standard_normal((5, 3)) * [1.0, 0.7, 0.5]

    body_mm = body_around(guide_mm)

    def scaled(size_mm: float) -> Bend:
        raw = Bend(centres_mm, size_mm * direction, length_mm, np.eye(4))
        return Bend(centres_mm, size_mm * direction, length_mm, rigid_part(raw(body_mm), body_mm))

    return scaled_to(scaled, guide_mm, max_mm, max_mm)


def body_around(guide_mm: Float64[np.ndarray, "g 3"]) -> Float64[np.ndarray, "b 3"]:
    """Take points of the tissue around a vessel, whose rigid motion is taken out of a displacement.

    A line alone leaves its roll open; with the tissue around it, the rigid part is that of the whole body.

    Parameters
    ----------
    guide_mm : ndarray, shape (g, 3)
        Points along the vessel in the bed frame in mm.

    Returns
    -------
    ndarray, shape (5 g, 3)
        These points and four around each, in mm.
    """
    aside_mm = np.array([[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]]) * BODY_MM
    return (guide_mm[:, None] + aside_mm).reshape(-1, 3)


def scaled_to(
    scaled: Callable[[float], Scaled], guide_mm: Float64[np.ndarray, "g 3"], max_mm: float, size_mm: float
) -> Scaled:
    """Scale a displacement so that the largest one along a vessel is as asked.

    Parameters
    ----------
    scaled : callable
        Makes the displacement of a size.
    guide_mm : ndarray, shape (g, 3)
        Points along the vessel in the bed frame in mm.
    max_mm : float
        Largest displacement of these points in mm.
    size_mm : float
        Size to begin with in mm.

    Returns
    -------
    Displacement
        The displacement.
    """
    # Its rigid part, which is taken out, is not linear in the size, but nearly so: a few corrections meet the maximum.
    for _ in range(6):
        largest_mm = float(np.linalg.norm(scaled(size_mm)(guide_mm) - guide_mm, axis=1).max())
        size_mm *= max_mm / largest_mm
    return scaled(size_mm)


@dataclass(frozen=True)
class Press:
    """Push of the probe in one frame, in image coordinates (lateral, depth, elevation).

    Parameters
    ----------
    depth_mm : float
        Displacement of the skin under the probe in mm.
    fade_mm : float
        Decay length in mm: deeper tissue follows less.
    half_width_mm : float
        Half the width of the probe's face in mm.
    squeeze : float
        Share by which tissue around ``centre_mm`` is flattened; it moves sideways instead.
    centre_mm : tuple[float, float]
        Lateral and depth coordinate of the flattened region's centre in mm.
    reach_mm : float
        Radius of that region in mm.
    """

    depth_mm: float
    fade_mm: float
    half_width_mm: float
    squeeze: float
    centre_mm: tuple[float, float]
    reach_mm: float

    def __call__(self, local_mm: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Compute where points lie when pressed.

        Parameters
        ----------
        local_mm : ndarray, shape (n, 3)
            Image coordinates in mm.

        Returns
        -------
        ndarray, shape (n, 3)
            Image coordinates in mm under pressure, in the precision of the input.
        """
        kind = local_mm.dtype.type
        pressed = local_mm.copy()
        below = np.maximum(local_mm[:, 1] + kind(self.depth_mm), kind(0.0))
        outside = (local_mm[:, 0] / kind(1.3 * self.half_width_mm)) ** 2
        along = (local_mm[:, 2] / kind(15.0)) ** 2
        pressed[:, 1] += kind(self.depth_mm) * np.exp(
            -below / kind(self.fade_mm) - outside**2 - kind(0.5) * along
        )
        if self.squeeze > 0:
            aside = local_mm[:, 0] - kind(self.centre_mm[0])
            deeper = local_mm[:, 1] - kind(self.centre_mm[1])
            near = np.exp((aside**2 + deeper**2) * kind(-0.5 / self.reach_mm**2) - kind(0.5) * along)
            pressed[:, 1] -= kind(self.squeeze) * near * deeper
            pressed[:, 0] += kind(self.squeeze) * near * aside
        return pressed


def undone(forward: Displacement | Press, moved: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
    """Find the points that a displacement moves to given places, by fixed-point iteration.

    Parameters
    ----------
    forward : Displacement or Press
        Displacement, a contraction plus the identity.
    moved : ndarray, shape (n, 3)
        Displaced points in mm.

    Returns
    -------
    ndarray, shape (n, 3)
        Points in mm before the displacement.
    """
    points = moved.copy()
    for _ in range(INVERSE_STEPS):
        points += moved - forward(points)
    return points


def rigid_part(
    moving_mm: Float64[np.ndarray, "n 3"], fixed_mm: Float64[np.ndarray, "n 3"]
) -> Float64[np.ndarray, "4 4"]:
    """Compute the rigid transform that brings one set of points closest to another.

    Parameters
    ----------
    moving_mm : ndarray, shape (n, 3)
        Points in mm.
    fixed_mm : ndarray, shape (n, 3)
        Their paired points in mm.

    Returns
    -------
    ndarray, shape (4, 4)
        Rigid transform from the first to the second.

    References
    ----------
    W. Kabsch, Acta Cryst. A32, 1976.
    """
    # By SciPy rather than geometry.rigid_fit: the frozen phantoms were made with it, to the last bit.
    middle, target = moving_mm.mean(axis=0), fixed_mm.mean(axis=0)
    rotation, _ = Rotation.align_vectors(fixed_mm - target, moving_mm - middle)
    return transforms.from_rotation(rotation, target - rotation.apply(middle))
