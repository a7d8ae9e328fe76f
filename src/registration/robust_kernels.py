"""Robust kernels: how much a residual counts, the less the larger it is beside what is usual.

A kernel is called with residuals in units of their usual size and gives weights for iteratively reweighted least
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
    """A weight that falls with the size of a residual."""

    def __call__(self, standardised: Float64[np.ndarray, "*n"]) -> Float64[np.ndarray, "*n"]:
        """Weights from 0 to 1 for residuals divided by their usual size."""
        ...


@dataclass(frozen=True)
class Huber:
    """Full weight up to ``tuning``, then falling as its inverse (Huber, Ann. Math. Stat. 35(1), 1964)."""

    tuning: float = 1.345

    def __post_init__(self) -> None:
        require_positive("tuning", self.tuning)

    def __call__(self, standardised: Float64[np.ndarray, "*n"]) -> Float64[np.ndarray, "*n"]:
        """Weights that never reach 0."""
        return self.tuning / np.maximum(np.abs(standardised), self.tuning)


@dataclass(frozen=True)
class Tukey:
    """Tukey's biweight: smoothly down to 0 at ``tuning`` (Beaton and Tukey, Technometrics 16(2), 1974)."""

    tuning: float = 4.685

    def __post_init__(self) -> None:
        require_positive("tuning", self.tuning)

    def __call__(self, standardised: Float64[np.ndarray, "*n"]) -> Float64[np.ndarray, "*n"]:
        """Weights that are 0 beyond the tuning."""
        return np.maximum(1.0 - (standardised / self.tuning) ** 2, 0.0) ** 2


@dataclass(frozen=True)
class Welsch:
    """Down like a bell curve of width ``tuning`` (Dennis and Welsch, Commun. Stat. B7(4), 1978)."""

    tuning: float = 2.985

    def __post_init__(self) -> None:
        require_positive("tuning", self.tuning)

    def __call__(self, standardised: Float64[np.ndarray, "*n"]) -> Float64[np.ndarray, "*n"]:
        """Weights that fall to almost 0."""
        return np.exp(-((standardised / self.tuning) ** 2))


def usual_size(residuals_mm: Float64[np.ndarray, "s n"], floor_mm: float) -> Float64[np.ndarray, "s 1"]:
    """The residuals' standard deviation as the median has it, for each row, at least ``floor_mm``."""
    return np.maximum(MEDIAN_TO_SIGMA * np.median(np.abs(residuals_mm), axis=1, keepdims=True), floor_mm)
