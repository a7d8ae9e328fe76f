"""What the residuals say of tissue that has moved: whether, by how much, and where that puts the model's points."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float64, Int64

from registration import transforms
from registration.brief import brief_repr
from registration.rigid.icp.correspondence import TreeTarget
from registration.rigid.residual_model.covariance import CovarianceParts
from registration.rigid.residual_model.grouped_residuals import grouped_residuals
from registration.rigid.residual_model.likelihood import fit_residuals
from registration.rigid.residual_model.posterior import Posterior

# Errors are drawn so often, at so many of the points that they are asked for.
DRAWS, POINTS = 400, 60
# The size of the errors is itself known only to a factor, whose logarithm has this standard deviation: fitted on
# deforming anatomies with seeds below 1000, with the inflation.
SIZE_DOUBT = 0.45
# A point that another pose loses counts like a residual of so many standard deviations.
OUTLIER_CAP = 3.0


@dataclass(frozen=True)
class Deformation:
    """Deformation of tissue that the residuals show.

    Parameters
    ----------
    detected : bool
        Whether the residuals show that tissue has moved.
    size_mm : float
        Root mean square displacement in mm of the wall that was swept, its rigid part left out, as it is expected from
        the residuals.
    gain : float
        By how much a smooth displacement raises the restricted log-likelihood of the residuals.
    posterior : Posterior
        Displacement given the residuals; the rigid one alone where no deformation is detected.
    block : ndarray of int, shape (m,)
        Group of each moving point.
    motion_mm : ndarray, shape (6,)
        Motion in mm that the pose was given since the residuals were taken.
    inflation : float
        Factor on the standard deviations of the predicted errors.
    seed : int
        Seed of the draws.
    posterior_T_fixed : ndarray, shape (4, 4), optional
        Transform from the result's fixed frame to that of the residuals; they differ where the clouds were swapped.
    expected_mm : float, optional
        Displacement of tissue in mm, per coordinate, that was expected before.
    unseen : Posterior or None, optional
        Displacement of that size which residuals like these would not show; None where none was expected.
    """

    detected: bool
    size_mm: float
    gain: float
    posterior: Posterior = field(repr=False)
    block: Int64[np.ndarray, " m"] = field(repr=False)
    motion_mm: Float64[np.ndarray, "6"] = field(repr=False)
    inflation: float = field(default=1.0, repr=False)
    seed: int = field(default=0, repr=False)
    posterior_T_fixed: Float64[np.ndarray, "4 4"] = field(default_factory=lambda: np.eye(4), repr=False)
    expected_mm: float = 0.0
    unseen: Posterior | None = field(default=None, repr=False)

    __repr__ = brief_repr

    @property
    def is_predicted(self) -> bool:
        """Whether the motion of tissue is in the errors that are predicted."""
        return self.detected or self.unseen is not None

    def errors_mm(self, points_mm: Float64[np.ndarray, "t 3"]) -> Float64[np.ndarray, "k p 3"]:
        """Draw by how far points of the model and their material, as it was swept, are apart.

        Parameters
        ----------
        points_mm : ndarray, shape (t, 3)
            Points in mm in the fixed coordinate frame; of many an even choice is taken.

        Returns
        -------
        ndarray, shape (k, p, 3)
            Errors in mm, in the frame of the residuals.
        """
        rng = np.random.default_rng(self.seed)
        errors_mm = self.posterior.errors_mm(
            transforms.apply(self.posterior_T_fixed, even_choice(points_mm)),
            self.motion_mm,
            DRAWS,
            rng,
            self.inflation,
        )
        return errors_mm * np.exp(SIZE_DOUBT * rng.standard_normal((len(errors_mm), 1, 1)))

    def unseen_mm(self, points_mm: Float64[np.ndarray, "t 3"], draws: int) -> Float64[np.ndarray, "k t 3"]:
        """Draw what an expected motion, which the residuals do not show, adds to the errors.

        Parameters
        ----------
        points_mm : ndarray, shape (t, 3)
            Points in mm in the fixed coordinate frame.
        draws : int
            Number of draws.

        Returns
        -------
        ndarray, shape (k, t, 3)
            Errors in mm; 0 where no motion was expected.
        """
        if self.unseen is None:
            return np.zeros((draws, len(points_mm), 3))
        rng = np.random.default_rng([self.seed, 1])
        return self.unseen.errors_mm(
            transforms.apply(self.posterior_T_fixed, points_mm), np.zeros(6), draws, rng
        )

    def rigid_motions_mm(self, points_mm: Float64[np.ndarray, "t 3"]) -> Float64[np.ndarray, "k 6"]:
        """Draw the rigid part of the errors (least squares).

        Parameters
        ----------
        points_mm : ndarray, shape (t, 3)
            Points in mm in the fixed coordinate frame.

        Returns
        -------
        ndarray, shape (k, 6)
            Motions in mm, about the centre of the residuals.
        """
        chosen_mm = even_choice(points_mm)
        errors_mm = self.errors_mm(chosen_mm).reshape(-1, 3 * len(chosen_mm))
        moved = self.posterior.moved(transforms.apply(self.posterior_T_fixed, chosen_mm))
        return np.asarray(np.linalg.lstsq(moved, errors_mm.T, rcond=None)[0].T)

    def gap_of(
        self,
        fixed_T_moving: Float64[np.ndarray, "4 4"],
        moving_mm: Float64[np.ndarray, "m 3"],
        target: TreeTarget,
        *,
        offset: bool,
        frame: Int64[np.ndarray, " m"] | None = None,
    ) -> float:
        """Compute by how many standard errors another pose fits worse than it would if it were the right one.

        The covariance is that of the best fit. The whitened residuals of the right pose have a sum of squares that
        is chi-squared distributed; a point that the pose loses counts as an outlier.

        Parameters
        ----------
        fixed_T_moving : ndarray, shape (4, 4)
            Pose.
        moving_mm : ndarray, shape (m, 3)
            Moving points in mm.
        target : TreeTarget
            Fixed cloud with normals.
        offset : bool
            Whether the walls may lie apart by the same distance everywhere.
        frame : ndarray of int, shape (m,), or None, optional
            Frame of each moving point.

        Returns
        -------
        float
            Standard errors.
        """
        fits, own = self.posterior.fits, self.posterior.residuals
        residuals = grouped_residuals(
            moving_mm, target, fixed_T_moving, block=self.block, offset=offset, frame=frame
        )
        freedom = 0 if residuals is None else len(residuals.gap_mm) - residuals.jacobian.shape[1]
        if residuals is None or freedom < 1:
            return float("inf")
        refitted = fit_residuals(residuals, CovarianceParts(residuals), [fits.ratios[fits.best]])
        worse = float(refitted.noise_mm2[0] / fits.noise_mm2[fits.best]) - 1.0
        worse += OUTLIER_CAP**2 * max(own.share - residuals.share, 0.0)
        return worse * float(np.sqrt(0.5 * freedom))

    def seen_from(self, posterior_T_fixed: Float64[np.ndarray, "4 4"]) -> Deformation:
        """Return the same for points of another frame.

        Parameters
        ----------
        posterior_T_fixed : ndarray, shape (4, 4)
            Transform from that frame to the one of the residuals.

        Returns
        -------
        Deformation
            The same deformation.
        """
        return replace(self, posterior_T_fixed=posterior_T_fixed)


def predicted_tre_mm(
    points_mm: Float64[np.ndarray, "t 3"],
    samples: Float64[np.ndarray, "b 4 4"],
    deformation: Deformation | None,
) -> Float64[np.ndarray, " k"]:
    """Draw the target registration error.

    Parameters
    ----------
    points_mm : ndarray, shape (t, 3)
        Targets in mm in the fixed coordinate frame.
    samples : ndarray, shape (b, 4, 4)
        Motions to where the pose might as well lie, which make the error where no tissue was found to have moved.
    deformation : Deformation or None
        What the residuals say of tissue; None where nobody looked.

    Returns
    -------
    ndarray, shape (k,)
        Root mean square errors in mm.
    """
    if deformation is not None and deformation.is_predicted:
        points_mm = even_choice(points_mm)
    if deformation is not None and deformation.detected:
        errors_mm = deformation.errors_mm(points_mm)
    else:
        errors_mm = points_mm @ np.swapaxes(samples[:, :3, :3], 1, 2) + samples[:, None, :3, 3] - points_mm
    if deformation is not None and deformation.unseen is not None:
        errors_mm = errors_mm + deformation.unseen_mm(points_mm, len(errors_mm))
    return np.asarray(np.sqrt((errors_mm**2).sum(axis=2).mean(axis=1)))


def even_choice(points_mm: Float64[np.ndarray, "t 3"]) -> Float64[np.ndarray, "p 3"]:
    """Choose points evenly where there are many.

    Parameters
    ----------
    points_mm : ndarray, shape (t, 3)
        Points in mm.

    Returns
    -------
    ndarray, shape (p, 3)
        All points, or an even choice of them.
    """
    if len(points_mm) <= POINTS:
        return points_mm
    return points_mm[np.linspace(0, len(points_mm) - 1, POINTS).round().astype(int)]
