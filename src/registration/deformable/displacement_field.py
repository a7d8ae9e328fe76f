"""A displacement as a function of place: its inverse, its derivative, and how plausible it is for tissue."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from jaxtyping import Float64

from registration.brief import brief_repr
from registration.errors import InputError

# Displacement in mm at points in mm, both of shape (n, 3) and in one frame.
DisplacementField: TypeAlias = Callable[[np.ndarray], np.ndarray]
# Derivatives are central differences over this distance in mm either way: far below any length that tissue bends over,
# far above rounding.
STEP_MM = 0.05
# The inverse is found to this distance in mm, or not at all.
INVERSE_TOLERANCE_MM, INVERSE_ITERATIONS = 1e-6, 100
# Derivatives are looked at in so many points of a cloud.
POINTS = 400


@dataclass(frozen=True)
class Plausibility:
    """How plausible a displacement is for tissue.

    Parameters
    ----------
    strain_max : float
        Largest principal strain at any point (Green and Lagrange), its sign left out.
    strain_p95 : float
        Its 95th percentile over the points.
    jacobian_min : float
        Smallest determinant of the derivative of the moved place: the factor on a small volume. At 0 and below the
        field folds.
    bending_energy_per_mm2 : float
        Mean squared second derivative in 1/mm², summed over components and pairs of directions.
    """

    strain_max: float
    strain_p95: float
    jacobian_min: float
    bending_energy_per_mm2: float

    __repr__ = brief_repr

    @property
    def folds(self) -> bool:
        """Whether the field folds, so that two places come to lie in one."""
        return self.jacobian_min <= 0


def gradient(field: DisplacementField, points_mm: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3 3"]:
    """Differentiate a displacement.

    Parameters
    ----------
    field : callable
        Displacement.
    points_mm : ndarray, shape (n, 3)
        Points in mm.

    Returns
    -------
    ndarray, shape (n, 3, 3)
        Derivative of each component (rows) by each coordinate (columns).
    """
    steps = STEP_MM * np.eye(3)
    sides = [field(points_mm + step) - field(points_mm - step) for step in steps]
    return np.stack(sides, axis=2) / (2.0 * STEP_MM)


def plausibility(field: DisplacementField, points_mm: Float64[np.ndarray, "n 3"]) -> Plausibility:
    """Measure how plausible a displacement is at points.

    Parameters
    ----------
    field : callable
        Displacement.
    points_mm : ndarray, shape (n, 3)
        Points in mm; of many an even choice is taken.

    Returns
    -------
    Plausibility
        The measures.
    """
    chosen_mm = points_mm[:: max(1, len(points_mm) // POINTS)]
    moved = np.eye(3) + gradient(field, chosen_mm)
    strain = 0.5 * (np.swapaxes(moved, 1, 2) @ moved - np.eye(3))
    largest = np.abs(np.linalg.eigvalsh(strain)).max(axis=1)
    # A wider step: second differences lose twice as many digits.
    wide = 20.0 * STEP_MM * np.eye(3)
    bends = [(gradient(field, chosen_mm + step) - gradient(field, chosen_mm - step)) for step in wide]
    second = np.stack(bends, axis=3) / (2.0 * wide[0, 0])
    return Plausibility(
        float(largest.max()),
        float(np.percentile(largest, 95)),
        float(np.linalg.det(moved).min()),
        float((second**2).sum(axis=(1, 2, 3)).mean()),
    )


def inverse_displacement(
    field: DisplacementField, points_mm: Float64[np.ndarray, "n 3"]
) -> Float64[np.ndarray, "n 3"]:
    """Find the displacement that undoes a field: added to a moved place, it leads back.

    Parameters
    ----------
    field : callable
        Displacement.
    points_mm : ndarray, shape (n, 3)
        Moved places in mm.

    Returns
    -------
    ndarray, shape (n, 3)
        Displacement in mm.

    Raises
    ------
    InputError
        If the fixed-point iteration does not end, as where the field folds.

    References
    ----------
    M. Chen et al., Med. Phys. 35(1), 2008.
    """
    back_mm = -field(points_mm)
    for _ in range(INVERSE_ITERATIONS):
        found_mm = -field(points_mm + back_mm)
        change_mm = float(np.abs(found_mm - back_mm).max(initial=0.0))
        back_mm = found_mm
        if change_mm <= INVERSE_TOLERANCE_MM:
            return np.asarray(back_mm)
    raise InputError(
        f"displacement: expected a field that can be inverted, received one whose inverse still changes by "
        f"{change_mm:.2g} mm after {INVERSE_ITERATIONS} iterations"
    )
