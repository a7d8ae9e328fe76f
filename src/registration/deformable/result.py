"""What a deformable registration hands back: a displacement, whether the data show it, and its error."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float64
from numpy.typing import ArrayLike

from registration.brief import brief_repr
from registration.checks import require_positive
from registration.deformable.displacement_field import DisplacementField, Plausibility, inverse_displacement
from registration.geometry.shapes import require_points
from registration.rigid.residual_model.deformation import even_choice
from registration.rigid.residual_model.posterior import Posterior

DEFORMED, RIGID_STANDS, FAILED = "deformed", "rigid stands", "failed"
# Errors are drawn so often.
DRAWS = 400


@dataclass(frozen=True)
class PredictedError:
    """Error of a displacement, as the residuals tell it.

    Parameters
    ----------
    posterior : Posterior
        Displacement given the residuals.
    taken : bool
        Whether the posterior's mean was taken for the displacement; otherwise none was.
    inflation : float
        Factor on the standard deviations.
    size_doubt : float
        Standard deviation of the logarithm of a further factor, drawn once for all points: how surely the size of the
        errors is known.
    seed : int, optional
        Seed of the draws.
    """

    posterior: Posterior = field(repr=False)
    taken: bool
    inflation: float
    size_doubt: float
    seed: int = 0

    def draw_mm(self, points_mm: Float64[np.ndarray, "t 3"]) -> Float64[np.ndarray, "k t 3"]:
        """Draw by how far displaced points and their material are apart.

        Parameters
        ----------
        points_mm : ndarray, shape (t, 3)
            Points in mm, before the displacement.

        Returns
        -------
        ndarray, shape (k, t, 3)
            Errors in mm.
        """
        rng = np.random.default_rng(self.seed)
        mean_mm = self.posterior.mean_mm(points_mm)
        drawn_mm = self.posterior.errors_mm(points_mm, np.zeros(6), DRAWS, rng, self.inflation)
        factor = np.exp(self.size_doubt * rng.standard_normal((len(drawn_mm), 1, 1)))
        return factor * (drawn_mm - mean_mm) + (0.0 if self.taken else mean_mm)


@dataclass(frozen=True)
class DeformableResult:
    """Result of a deformable registration of two clouds that a rigid one has brought together.

    Parameters
    ----------
    moved_mm : ndarray, shape (m, 3)
        Displaced moving points in mm.
    displacement_field : callable
        Displacement in mm at any points in mm of the common frame, before the displacement.
    verdict : str
        ``deformed``, ``rigid stands`` where the data show no deformation and none is applied, or ``failed``.
    reason : str
        Reason of the verdict in one sentence.
    plausibility : Plausibility
        Strain, folding and bending energy at the moving points.
    rmse_mm : float
        Root mean square distance in mm from every fixed point to the closest displaced one: a residual, no accuracy. It
        falls as the moving cloud grows denser; ``registration.metrics`` measures to triangles.
    gain : float
        By how much a deformation raises the restricted log-likelihood; NaN for ``residual="point"``.
    size_mm : float
        Root mean square displacement in mm of the wall that was seen, its rigid part left out.
    iterations : int
        Number of iterations.
    converged : bool
        Whether they came to rest.
    runtime_s : float
        Duration in s.
    predicted : PredictedError or None, optional
        Error of the displacement; None where none is predicted.
    """

    moved_mm: Float64[np.ndarray, "m 3"] = field(repr=False)
    displacement_field: DisplacementField = field(repr=False)
    verdict: str
    reason: str
    plausibility: Plausibility
    rmse_mm: float
    gain: float
    size_mm: float
    iterations: int
    converged: bool
    runtime_s: float
    predicted: PredictedError | None = field(default=None, repr=False)

    __repr__ = brief_repr

    def displacement(self, points_mm: ArrayLike) -> Float64[np.ndarray, "n 3"]:
        """Compute the displacement at any points.

        Parameters
        ----------
        points_mm : ndarray, shape (n, 3)
            Points in mm in the common frame, where the moving cloud's material was before.

        Returns
        -------
        ndarray, shape (n, 3)
            Displacement in mm.

        Raises
        ------
        InputError
            If a point is none.
        """
        return np.asarray(self.displacement_field(require_points(points_mm, "points_mm", 1)))

    def inverse(self, points_mm: ArrayLike) -> Float64[np.ndarray, "n 3"]:
        """Compute the displacement back: added to a displaced place, it gives the place before.

        Parameters
        ----------
        points_mm : ndarray, shape (n, 3)
            Displaced places in mm.

        Returns
        -------
        ndarray, shape (n, 3)
            Displacement in mm.

        Raises
        ------
        InputError
            If a point is none, or the field cannot be inverted.
        """
        return inverse_displacement(self.displacement_field, require_points(points_mm, "points_mm", 1))

    def tre_interval_mm(self, targets_mm: ArrayLike, level: float = 0.9) -> tuple[float, float]:
        """Predict where the target registration error lies, after the displacement.

        The noise of the residuals, the freedom that they leave to tissue, which grows with the distance from what was
        seen, and the error of the pose are in it.

        Parameters
        ----------
        targets_mm : ndarray, shape (t, 3)
            Targets in mm in the common frame, before the displacement.
        level : float, optional
            Probability that the error lies in the interval, above 0 to 1.

        Returns
        -------
        low_mm : float
            Lower end in mm; NaN where no error is predicted, or one beyond the size of the moving cloud: the clouds
            leave it open.
        high_mm : float
            Upper end in mm; NaN likewise.

        Raises
        ------
        InputError
            If there is no target, a target is no point, or the level is outside 0 to 1.
        """
        targets = require_points(targets_mm, "targets_mm", 1)
        require_positive("level", level, 1.0)
        if self.predicted is None:
            return float("nan"), float("nan")
        errors_mm = self.predicted.draw_mm(even_choice(targets))
        tre_mm = np.sqrt((errors_mm**2).sum(axis=2).mean(axis=1))
        low_mm, high_mm = np.quantile(tre_mm, [(1 - level) / 2, (1 + level) / 2])
        if not high_mm < np.linalg.norm(np.ptp(self.moved_mm, axis=0)):
            return float("nan"), float("nan")
        return float(low_mm), float(high_mm)
