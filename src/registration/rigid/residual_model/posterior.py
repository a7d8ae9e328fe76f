"""What the residuals at a pose say of where tissue has gone: pose and displacement, anywhere, with their covariance."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float64
from scipy.linalg import solve_triangular
from scipy.spatial.distance import cdist

from registration.rigid.icp.estimation import motion_jacobian
from registration.rigid.residual_model.covariance import CovarianceParts, Ratios, matern
from registration.rigid.residual_model.grouped_residuals import GroupedResiduals
from registration.rigid.residual_model.likelihood import Fits, fit_residuals

# Rounding may make a covariance indefinite by less than this share of its mean variance.
ROUNDING = 1e-9


@dataclass(frozen=True)
class Posterior:
    """Displacement of tissue against the model, given the residuals at a pose.

    The material at a point lies off by a rigid motion and by a smooth displacement, both unknown: universal kriging,
    with the motion as its trend. Where nothing was swept the displacement is as free as it was before.

    Parameters
    ----------
    residuals : GroupedResiduals
        Residuals.
    fits : Fits
        Their fits under the covariances that are probable.

    References
    ----------
    N. Cressie, Statistics for Spatial Data, Wiley, 1993, section 3.4.
    """

    residuals: GroupedResiduals
    fits: Fits

    @cached_property
    def _solved(self) -> tuple[_Solved, ...]:
        parts = CovarianceParts(self.residuals)
        return tuple(
            _solve(self.residuals, parts(ratios), motion_mm)
            for ratios, motion_mm in zip(self.fits.ratios, self.fits.motion_mm, strict=True)
        )

    def mean_mm(self, points_mm: Float64[np.ndarray, "t 3"]) -> Float64[np.ndarray, "t 3"]:
        """Compute the expected displacement that brings the moved material at points onto the model.

        Parameters
        ----------
        points_mm : ndarray, shape (t, 3)
            Points in mm in the fixed coordinate frame.

        Returns
        -------
        ndarray, shape (t, 3)
            Displacement in mm, its rigid part in it.
        """
        moved = self.moved(points_mm)
        means = [
            moved @ motion_mm[:6] + self._cross(points_mm, ratios) @ solved.left
            for ratios, motion_mm, solved in zip(
                self.fits.ratios, self.fits.motion_mm, self._solved, strict=True
            )
        ]
        return np.asarray(self.fits.weights @ np.stack(means)).reshape(-1, 3)

    def rigid_part_mm(self, points_mm: Float64[np.ndarray, "t 3"]) -> Float64[np.ndarray, "6"]:
        """Compute the motion that brings material at points nearest to the model, in expectation (least squares).

        Parameters
        ----------
        points_mm : ndarray, shape (t, 3)
            Points in mm in the fixed coordinate frame.

        Returns
        -------
        ndarray, shape (6,)
            Motion in mm.
        """
        found: np.ndarray = np.linalg.lstsq(
            self.moved(points_mm), self.mean_mm(points_mm).reshape(-1), rcond=None
        )[0]
        return found

    def bent_mm(self) -> float:
        """Compute the expected displacement of the wall that was swept, its rigid part left out.

        Returns
        -------
        float
            Root mean square displacement in mm.
        """
        points_mm = self.residuals.points_mm
        rigid_mm = self.moved(points_mm) @ self.rigid_part_mm(points_mm)
        bent_mm = self.mean_mm(points_mm) - rigid_mm.reshape(-1, 3)
        return float(np.sqrt((bent_mm**2).sum(axis=1).mean()))

    def errors_mm(
        self,
        points_mm: Float64[np.ndarray, "t 3"],
        motion_mm: Float64[np.ndarray, "6"],
        draws: int,
        rng: np.random.Generator,
        inflation: float = 1.0,
    ) -> Float64[np.ndarray, "k t 3"]:
        """Draw by how far the model's points and their material are apart after a motion.

        Parameters
        ----------
        points_mm : ndarray, shape (t, 3)
            Points in mm in the fixed coordinate frame.
        motion_mm : ndarray, shape (6,)
            Motion in mm that the moved cloud is given.
        draws : int
            About how many draws.
        rng : numpy.random.Generator
            Source of the draws.
        inflation : float, optional
            Factor on the standard deviations.

        Returns
        -------
        ndarray, shape (k, t, 3)
            Errors in mm.
        """
        moved = self.moved(points_mm)
        apart_mm = cdist(points_mm, points_mm)
        counts = rng.multinomial(draws, self.fits.weights)
        drawn = []
        for place in np.flatnonzero(counts):
            ratios, solved = self.fits.ratios[place], self._solved[place]
            noise_mm2 = self.fits.noise_mm2[place]
            cross = self._cross(points_mm, ratios)
            mean_mm = moved @ (self.fits.motion_mm[place, :6] - motion_mm) + cross @ solved.left
            trend = -cross @ solved.trend
            trend[:, :6] += moved
            white = solve_triangular(solved.factor, cross.T, lower=True, check_finite=False)
            prior = ratios.displacement * matern(apart_mm, ratios.length_mm)
            covariance = np.kron(prior, np.eye(3)) - white.T @ white
            covariance += trend @ self.fits.spread[place] @ trend.T
            root = _root(covariance)
            normal = rng.standard_normal((counts[place], len(root)))
            scale_mm = np.sqrt(
                noise_mm2 * self.fits.freedom / rng.chisquare(self.fits.freedom, (counts[place], 1))
            )
            drawn.append(mean_mm + inflation * scale_mm * (normal @ root.T))
        return np.concatenate(drawn).reshape(-1, len(points_mm), 3)

    def moved(self, points_mm: Float64[np.ndarray, "t 3"]) -> Float64[np.ndarray, "w 6"]:
        """Compute the derivative of points' displacement by the motion of the cloud.

        Parameters
        ----------
        points_mm : ndarray, shape (t, 3)
            Points in mm in the fixed coordinate frame.

        Returns
        -------
        ndarray, shape (3 t, 6)
            Derivatives of x, y and z of each point, one point after the other.
        """
        arms = np.repeat((points_mm - self.residuals.centre_mm) / self.residuals.radius_mm, 3, axis=0)
        return motion_jacobian(arms, np.tile(np.eye(3), (len(points_mm), 1)))

    def _cross(self, points_mm: np.ndarray, ratios: Ratios) -> np.ndarray:
        """Covariance of the displacement of points with the residuals, over the noise's variance."""
        near = ratios.displacement * matern(cdist(points_mm, self.residuals.points_mm), ratios.length_mm)
        return np.einsum("tg,gk->tkg", near, self.residuals.normals).reshape(-1, len(self.residuals.normals))


@dataclass(frozen=True)
class _Solved:
    """Cholesky factor of a covariance, and its inverse times what the fit leaves and times the Jacobian."""

    factor: np.ndarray
    left: np.ndarray
    trend: np.ndarray


def _solve(residuals: GroupedResiduals, covariance: np.ndarray, motion_mm: np.ndarray) -> _Solved:
    factor = np.linalg.cholesky(covariance)
    left_mm = residuals.gap_mm - residuals.jacobian @ motion_mm
    both = np.column_stack([residuals.jacobian, left_mm])
    white = solve_triangular(factor, both, lower=True, check_finite=False)
    solved = solve_triangular(factor, white, lower=True, trans="T", check_finite=False)
    return _Solved(factor, solved[:, -1], solved[:, :-1])


def _root(covariance: np.ndarray) -> np.ndarray:
    covariance[np.diag_indices(len(covariance))] += ROUNDING * (1.0 + np.trace(covariance) / len(covariance))
    return np.linalg.cholesky(covariance)


def unseen(residuals: GroupedResiduals, fits: Fits, size_mm: float, length_mm: float) -> Posterior:
    """Make the displacement of a given size that would leave residuals of nothing but noise.

    Parameters
    ----------
    residuals : GroupedResiduals
        Residuals at a pose, of which the places and the noise are taken.
    fits : Fits
        Their fits.
    size_mm : float
        Standard deviation of the displacement per coordinate in mm.
    length_mm : float
        Length in mm over which it hangs together.

    Returns
    -------
    Posterior
        Displacement with the mean 0, and all of the freedom that the places leave to it.
    """
    best = fits.ratios[fits.best]
    noise_mm2 = float(fits.noise_mm2[fits.best])
    ratios = Ratios(length_mm, size_mm**2 / noise_mm2, best.border, best.jitter)
    flat = replace(residuals, gap_mm=np.zeros_like(residuals.gap_mm))
    free = fit_residuals(flat, CovarianceParts(flat), [ratios])
    return Posterior(flat, replace(free, noise_mm2=np.array([noise_mm2])))
