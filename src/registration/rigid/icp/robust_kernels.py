"""Robust kernels: weights that fall the larger a residual is against the robust scale of all.

A kernel is called with residuals in units of their robust scale and gives weights for iteratively reweighted least
squares (Holland and Welsch, Commun. Stat. A6(9), 1977). Tunings are those for 95 % efficiency on normal residuals.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float64

from registration.checks import require_positive

# The median of the absolute value of a standard normal variable is 1 / 1.4826.
MEDIAN_TO_SIGMA = 1.4826


@runtime_checkable
class RobustKernel(Protocol):
    """Weight function that falls with the size of a residual."""

    def __call__(self, standardised: Float64[np.ndarray, " *n"]) -> Float64[np.ndarray, " *n"]:
        """Compute the weights.

        Parameters
        ----------
        standardised : ndarray
            Residuals divided by their robust scale.

        Returns
        -------
        ndarray
            Weights from 0 to 1, of the same shape.
        """
        ...


@dataclass(frozen=True)
class Huber:
    """Huber's kernel: full weight up to the tuning constant, then falling as its inverse.

    Parameters
    ----------
    tuning : float, optional
        Tuning constant in units of the robust scale.

    Raises
    ------
    InputError
        If the tuning is not positive.

    References
    ----------
    P. J. Huber, Ann. Math. Stat. 35(1), 1964.
    """

    tuning: float = 1.345

    def __post_init__(self) -> None:
        require_positive("tuning", self.tuning)

    def __call__(self, standardised: Float64[np.ndarray, " *n"]) -> Float64[np.ndarray, " *n"]:
        """Compute weights that never reach 0.

        Parameters
        ----------
        standardised : ndarray
            Residuals divided by their robust scale.

        Returns
        -------
        ndarray
            Weights above 0 to 1, of the same shape.
        """
        return self.tuning / np.maximum(np.abs(standardised), self.tuning)


@dataclass(frozen=True)
class Tukey:
    """Tukey's biweight: smoothly down to 0 at the tuning constant.

    Parameters
    ----------
    tuning : float, optional
        Tuning constant in units of the robust scale.

    Raises
    ------
    InputError
        If the tuning is not positive.

    References
    ----------
    A. E. Beaton and J. W. Tukey, Technometrics 16(2), 1974.
    """

    tuning: float = 4.685

    def __post_init__(self) -> None:
        require_positive("tuning", self.tuning)

    def __call__(self, standardised: Float64[np.ndarray, " *n"]) -> Float64[np.ndarray, " *n"]:
        """Compute weights that are 0 beyond the tuning constant.

        Parameters
        ----------
        standardised : ndarray
            Residuals divided by their robust scale.

        Returns
        -------
        ndarray
            Weights from 0 to 1, of the same shape.
        """
        return np.maximum(1.0 - (standardised / self.tuning) ** 2, 0.0) ** 2


@dataclass(frozen=True)
class Welsch:
    """Welsch's kernel: down like a bell curve whose width is the tuning constant.

    Parameters
    ----------
    tuning : float, optional
        Tuning constant in units of the robust scale.

    Raises
    ------
    InputError
        If the tuning is not positive.

    References
    ----------
    J. E. Dennis and R. E. Welsch, Commun. Stat. B7(4), 1978.
    """

    tuning: float = 2.985

    def __post_init__(self) -> None:
        require_positive("tuning", self.tuning)

    def __call__(self, standardised: Float64[np.ndarray, " *n"]) -> Float64[np.ndarray, " *n"]:
        """Compute weights that fall to almost 0.

        Parameters
        ----------
        standardised : ndarray
            Residuals divided by their robust scale.

        Returns
        -------
        ndarray
            Weights from 0 to 1, of the same shape.
        """
        return np.exp(-((standardised / self.tuning) ** 2))


def robust_scale(residuals_mm: Float64[np.ndarray, "s n"], floor_mm: float) -> Float64[np.ndarray, "s 1"]:
    """Compute the robust scale of each row: the standard deviation as the median of absolute values has it.

    Parameters
    ----------
    residuals_mm : ndarray, shape (s, n)
        Residuals in mm, one row for each pose.
    floor_mm : float
        Smallest scale in mm.

    Returns
    -------
    ndarray, shape (s, 1)
        Scale of each row in mm.
    """
    return np.maximum(MEDIAN_TO_SIGMA * np.median(np.abs(residuals_mm), axis=1, keepdims=True), floor_mm)
