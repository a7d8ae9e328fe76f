"""Covariance of the residuals: what tissue, borders, frames and noise each add, in parts of the noise's variance."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from scipy.spatial.distance import cdist

from registration.rigid.residual_model.grouped_residuals import GroupedResiduals

# Lengths in mm over which the error of a border hangs together: that of a few voxels, and that of a calibre.
BORDER_LENGTHS_MM = (4.0, 12.0)


@dataclass(frozen=True)
class Ratios:
    """Variances of the parts of the covariance over that of the noise of a group.

    Parameters
    ----------
    length_mm : float
        Length in mm over which tissue moves together.
    displacement : float
        Variance of the displacement of tissue, per coordinate.
    border : float
        Variance of the error of the borders along the normals.
    jitter : float
        Variance of the shift of a frame, as the groups show it.
    """

    length_mm: float
    displacement: float
    border: float
    jitter: float


def tried_ratios(
    lengths_mm: Sequence[float],
    displacement: Sequence[float],
    border: Sequence[float],
    jitter: Sequence[float],
) -> tuple[Ratios, ...]:
    """List covariances of all combinations; without displacement its length makes no difference, and occurs once.

    Parameters
    ----------
    lengths_mm : sequence of float
        Lengths in mm over which tissue moves together.
    displacement, border, jitter : sequence of float
        Variances of each part over that of the noise of a group.

    Returns
    -------
    tuple of Ratios
        The covariances.
    """
    return tuple(
        Ratios(length_mm, *parts)
        for number, length_mm in enumerate(lengths_mm)
        for parts in itertools.product(displacement, border, jitter)
        if parts[0] > 0 or number == 0
    )


class CovarianceParts:
    """Covariance of grouped residuals for any ratios.

    The displacement of tissue is an isotropic vector Gaussian process with the Matérn function of order 5/2, seen along
    the normals. The error of the borders is a scalar process along them, of two lengths.

    Parameters
    ----------
    residuals : GroupedResiduals
        Residuals at a pose.

    References
    ----------
    C. E. Rasmussen and C. K. I. Williams, Gaussian Processes for Machine Learning, MIT Press, 2006, section 4.2.
    """

    def __init__(self, residuals: GroupedResiduals) -> None:
        self._points_mm = residuals.points_mm
        self.facing: np.ndarray = residuals.normals @ residuals.normals.T
        squared_mm2 = cdist(residuals.points_mm, residuals.points_mm, "sqeuclidean")
        self._away_mm = np.sqrt(squared_mm2)
        each = [np.exp(-0.5 * squared_mm2 / length_mm**2) for length_mm in BORDER_LENGTHS_MM]
        self._border: np.ndarray = sum(each) / len(each)
        if residuals.on_wall is not None:
            self._border *= np.outer(residuals.on_wall, residuals.on_wall)
        self._noise = np.ones(len(squared_mm2)) if residuals.own_noise is None else residuals.own_noise
        self._jitter: np.ndarray | None = None
        if residuals.shared_frames is not None:
            shared = residuals.shared_frames * self.facing
            self._jitter = shared / max(float(np.diag(shared).mean()), np.finfo(np.float64).tiny)
        self._displacement: dict[float, np.ndarray] = {}

    def displacement(self, length_mm: float) -> Float64[np.ndarray, "g g"]:
        """Compute the covariance of the displacement along the normals, for a variance of 1 per coordinate.

        Parameters
        ----------
        length_mm : float
            Length in mm.

        Returns
        -------
        ndarray, shape (g, g)
            Covariance.
        """
        if length_mm not in self._displacement:
            self._displacement[length_mm] = self.facing * matern(self._away_mm, length_mm)
        return self._displacement[length_mm]

    def __call__(self, ratios: Ratios) -> Float64[np.ndarray, "g g"]:
        """Compute the covariance in parts of the noise's variance.

        Parameters
        ----------
        ratios : Ratios
            Variances of the parts.

        Returns
        -------
        ndarray, shape (g, g)
            Covariance.
        """
        covariance = ratios.border * self._border
        if ratios.displacement > 0:
            covariance += ratios.displacement * self.displacement(ratios.length_mm)
        if ratios.jitter > 0 and self._jitter is not None:
            covariance += ratios.jitter * self._jitter
        covariance[np.diag_indices(len(covariance))] += self._noise
        return covariance


def matern(away_mm: Float64[np.ndarray, "*n"], length_mm: float) -> Float64[np.ndarray, "*n"]:
    """Compute the Matérn correlation of order 5/2.

    Parameters
    ----------
    away_mm : ndarray
        Distances in mm.
    length_mm : float
        Length in mm.

    Returns
    -------
    ndarray
        Correlations.
    """
    scaled = np.sqrt(5.0) / length_mm * away_mm
    return (1.0 + scaled + scaled**2 / 3.0) * np.exp(-scaled)
