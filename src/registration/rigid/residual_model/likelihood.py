"""Restricted likelihood of the residuals at a pose under many covariances, and what each says of the pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float64
from scipy.linalg import solve_triangular

from registration.rigid.residual_model.covariance import CovarianceParts, Ratios
from registration.rigid.residual_model.grouped_residuals import GroupedResiduals

# A direction with less than this share of the mean stiffness is as good as free.
FREE_SHARE = 1e-6
# Clouds that fit each other without noise are taken to have this much of it, in mm.
MIN_NOISE_MM = 1e-6


@dataclass(frozen=True)
class Fits:
    """Generalised-least-squares fits of the same residuals under k covariances.

    Parameters
    ----------
    ratios : tuple of Ratios
        The covariances.
    log_likelihood : ndarray, shape (k,)
        Restricted log-likelihood of each.
    noise_mm2 : ndarray, shape (k,)
        Variance of the noise of a group in mm².
    motion_mm : ndarray, shape (k, u)
        Motion that fits the residuals best, in mm, and the offset of the walls where there is one.
    spread : ndarray, shape (k, u, u)
        Covariance of the motion over the noise's variance.
    freedom : int
        Degrees of freedom of the noise.
    """

    ratios: tuple[Ratios, ...]
    log_likelihood: Float64[np.ndarray, " k"]
    noise_mm2: Float64[np.ndarray, " k"]
    motion_mm: Float64[np.ndarray, "k u"]
    spread: Float64[np.ndarray, "k u u"]
    freedom: int

    @cached_property
    def weights(self) -> Float64[np.ndarray, " k"]:
        """How probable each covariance is where all were as probable before."""
        above = np.exp(self.log_likelihood - self.log_likelihood.max())
        return np.asarray(above / above.sum())

    @cached_property
    def is_still(self) -> Bool[np.ndarray, " k"]:
        """Which covariances have no displacement of tissue."""
        return np.array([one.displacement == 0 for one in self.ratios])

    @property
    def gain(self) -> float:
        """By how much the best log-likelihood with a displacement of tissue exceeds the best one without."""
        still = self.log_likelihood[self.is_still]
        return float(self.log_likelihood.max() - still.max()) if len(still) else float("inf")

    @property
    def best(self) -> int:
        """Index of the most probable covariance."""
        return int(self.log_likelihood.argmax())

    def chosen(self, least: float, still: bool = False) -> Fits:
        """Return the fits under the covariances that are at least so probable.

        Parameters
        ----------
        least : float
            Smallest probability over that of the most probable one.
        still : bool, optional
            Whether only those without a displacement of tissue are looked at.

        Returns
        -------
        Fits
            The fits, the best one among them.
        """
        weights = np.where(self.is_still, self.weights, 0.0) if still else self.weights
        kept = weights >= least * weights.max()
        return Fits(
            tuple(one for one, is_kept in zip(self.ratios, kept, strict=True) if is_kept),
            self.log_likelihood[kept],
            self.noise_mm2[kept],
            self.motion_mm[kept],
            self.spread[kept],
            self.freedom,
        )


def fit_residuals(residuals: GroupedResiduals, parts: CovarianceParts, tried: Sequence[Ratios]) -> Fits:
    """Fit the residuals at a pose under each covariance.

    Parameters
    ----------
    residuals : GroupedResiduals
        Residuals.
    parts : CovarianceParts
        Their covariance.
    tried : sequence of Ratios
        Covariances to try.

    Returns
    -------
    Fits
        The fits.

    References
    ----------
    H. D. Patterson and R. Thompson, Biometrika 58(3), 1971 (restricted likelihood).
    """
    groups, unknowns = residuals.jacobian.shape
    freedom = groups - unknowns
    both = np.column_stack([residuals.jacobian, residuals.gap_mm])
    found = [_fit(parts(ratios), both, freedom) for ratios in tried]
    log_likelihood, noise_mm2, motion_mm, spread = (np.stack(part) for part in zip(*found, strict=True))
    return Fits(tuple(tried), log_likelihood, noise_mm2, motion_mm, spread, freedom)


def _fit(
    covariance: np.ndarray, both: np.ndarray, freedom: int
) -> tuple[float, float, np.ndarray, np.ndarray]:
    factor = np.linalg.cholesky(covariance)
    white = solve_triangular(factor, both, lower=True, check_finite=False)
    jacobian, gap_mm = white[:, :-1], white[:, -1]
    stiffness = jacobian.T @ jacobian
    unknowns = len(stiffness)
    stiffness[np.diag_indices(unknowns)] += FREE_SHARE * np.trace(stiffness) / unknowns
    spread = np.linalg.inv(stiffness)
    motion_mm = spread @ (jacobian.T @ gap_mm)
    left_mm = gap_mm - jacobian @ motion_mm
    noise_mm2 = left_mm @ left_mm / freedom + MIN_NOISE_MM**2
    log_likelihood = -0.5 * freedom * np.log(noise_mm2) - np.log(np.diag(factor)).sum()
    log_likelihood -= 0.5 * np.linalg.slogdet(stiffness)[1]
    return float(log_likelihood), float(noise_mm2), motion_mm, spread
