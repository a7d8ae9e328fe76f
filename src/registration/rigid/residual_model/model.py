"""Settings of the model of the residuals, and its use at a pose: has tissue moved, and what pose is left then."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64, Int64

from registration import transforms
from registration.checks import require_at_least, require_count, require_positive, require_positive_each
from registration.rigid.icp.correspondence import TreeTarget
from registration.rigid.residual_model.covariance import CovarianceParts, Ratios, tried_ratios
from registration.rigid.residual_model.deformation import Deformation
from registration.rigid.residual_model.grouped_residuals import grouped_residuals, groups_on
from registration.rigid.residual_model.likelihood import fit_residuals
from registration.rigid.residual_model.mirror_image import mirrored_misfit_mm, misfit_mm
from registration.rigid.residual_model.posterior import Posterior, unseen
from registration.rigid.residual_model.right_vessel import probability_right_vessel

# Variances that are tried, over that of a group's noise: of the displacement of tissue, of the borders, and of a frame.
# Larger ones would read more from the residuals than closest points on a displaced wall can say: the pose gets worse.
DISPLACEMENT = (0.0, 1.0, 5.0, 25.0, 125.0)
BORDER, JITTER = (2.0, 12.0, 60.0), (0.0, 2.0)
# An expected motion hangs together over this length in mm: a shorter one would show.
UNSEEN_LENGTH_MM = 45.0
# A displacement below this share of the distance between fixed points is the sampling's, not the tissue's.
MIN_SIZE_SPACINGS = 0.1
# A model that finds the vessel less probable than this does not describe the clouds, and corrects nothing.
IMPROBABLE = 0.05
# Covariances less probable than this share of the best one say nothing more.
LIKELY = 0.1
# A group has about this many points at least; fewer groups than this many per unknown say too little.
GROUP_POINTS, GROUPS_PER_UNKNOWN = 4, 3


@dataclass(frozen=True)
class Assessed:
    """What the residuals at a pose say.

    Parameters
    ----------
    fixed_T_moving : ndarray, shape (4, 4)
        Pose, corrected where a deformation is detected.
    deformation : Deformation
        Deformation of tissue.
    probability_right_vessel : float
        Probability that both clouds show one vessel.
    """

    fixed_T_moving: Float64[np.ndarray, "4 4"]
    deformation: Deformation
    probability_right_vessel: float


@dataclass(frozen=True)
class ResidualModel:
    """Gaussian-process model of the residuals at a pose.

    What is left is a smooth displacement of tissue, an error of the borders, a shift of each frame, and noise. Their
    variances are tried on a grid, and weighed by the restricted likelihood.

    Parameters
    ----------
    patches : int, optional
        Number of patches of the wall, the groups of points that residuals are averaged over, rounded to a power of two.
    lengths_mm : sequence of float, optional
        Lengths in mm over which tissue may move together.
    min_gain : float, optional
        Smallest gain in restricted log-likelihood by which a deformation is detected.
    correct_pose : bool, optional
        Whether a deformation that is detected corrects the pose.
    inflation : float, optional
        Factor on the standard deviation of the errors that are predicted with a deformation; the default was set so
        that 90 % intervals hold on deforming anatomies with seeds below 1000.
    expected_deformation_mm : float, optional
        Displacement of tissue in mm, per coordinate, that is expected before the clouds are seen. What of it the
        residuals would not show, as a bend that a slide mimics, enters the predicted error; 0 leaves it out. More than
        2 mm also lets a right vessel differ more.

    Raises
    ------
    InputError
        If there are fewer than 16 patches, no length, or a number is out of range.
    """

    patches: int = 128
    lengths_mm: Sequence[float] = (15.0, 25.0, 45.0)
    min_gain: float = 8.0
    correct_pose: bool = True
    inflation: float = 1.1
    expected_deformation_mm: float = 0.0

    def __post_init__(self) -> None:
        require_count("patches", self.patches, 16)
        lengths_mm = require_positive_each("lengths_mm", self.lengths_mm, "length")
        object.__setattr__(self, "lengths_mm", lengths_mm)
        require_positive("min_gain", self.min_gain)
        require_positive("inflation", self.inflation)
        require_at_least("expected_deformation_mm", self.expected_deformation_mm, 0.0)

    def tried(self, with_frames: bool) -> tuple[Ratios, ...]:
        """List the covariances that are tried.

        Parameters
        ----------
        with_frames : bool
            Whether frames are known.

        Returns
        -------
        tuple of Ratios
            The covariances; without displacement its length makes no difference, and occurs once.
        """
        return tried_ratios(self.lengths_mm, DISPLACEMENT, BORDER, JITTER if with_frames else (0.0,))

    def __call__(
        self,
        moving_mm: Float64[np.ndarray, "m 3"],
        target: TreeTarget,
        fixed_T_moving: Float64[np.ndarray, "4 4"],
        places_mm: Float64[np.ndarray, "p 3"],
        *,
        offset: bool,
        frame: Int64[np.ndarray, " m"] | None = None,
        allowed: Callable[[Float64[np.ndarray, "4 4"]], bool] | None = None,
        seed: int = 0,
    ) -> Assessed | None:
        """Fit the model at a pose.

        Parameters
        ----------
        moving_mm : ndarray, shape (m, 3)
            Moving points in mm.
        target : TreeTarget
            Fixed cloud with normals.
        fixed_T_moving : ndarray, shape (4, 4)
            Pose.
        places_mm : ndarray, shape (p, 3)
            Points of the fixed cloud in mm that a corrected pose brings nearest to where they were swept.
        offset : bool
            Whether the walls may lie apart by the same distance everywhere.
        frame : ndarray of int, shape (m,), or None, optional
            Frame of each moving point; None leaves out the part of the frames.
        allowed : callable or None, optional
            Tells whether a corrected pose may be the result.
        seed : int, optional
            Seed of later draws.

        Returns
        -------
        Assessed or None
            Pose, deformation and probability of the right vessel; None for clouds that are too small.
        """
        groups = min(self.patches, len(moving_mm) // GROUP_POINTS)
        if groups < 2:
            return None
        block = groups_on(moving_mm, target, fixed_T_moving, groups)
        residuals = grouped_residuals(
            moving_mm, target, fixed_T_moving, block=block, offset=offset, frame=frame
        )
        if residuals is None:
            return None
        count, unknowns = residuals.jacobian.shape
        if count < GROUPS_PER_UNKNOWN * unknowns:
            return None
        fits = fit_residuals(residuals, CovarianceParts(residuals), self.tried(frame is not None))
        posterior = Posterior(residuals, fits.chosen(LIKELY))
        size_mm = posterior.bent_mm()
        detected = fits.gain >= self.min_gain and size_mm >= MIN_SIZE_SPACINGS * target.spacing_mm
        if not detected:
            posterior = Posterior(residuals, fits.chosen(LIKELY, still=True))
        mirrored_mm = mirrored_misfit_mm(moving_mm, target, fixed_T_moving, block=block, offset=offset)
        probability = probability_right_vessel(
            misfit_mm(residuals), mirrored_mm, 1.0 - residuals.share, self.expected_deformation_mm
        )
        pose, motion_mm = fixed_T_moving, np.zeros(6)
        if detected and self.correct_pose and probability >= IMPROBABLE:
            step_mm = posterior.rigid_part_mm(places_mm)
            corrected = transforms.compose(residuals.motions(step_mm[None])[0], fixed_T_moving)
            if allowed is None or allowed(corrected):
                pose, motion_mm = corrected, step_mm
        bent = Deformation(detected, size_mm, fits.gain, posterior, block, motion_mm, self.inflation, seed)
        if self.expected_deformation_mm > 0:
            free = unseen(residuals, fits, self.expected_deformation_mm, UNSEEN_LENGTH_MM)
            bent = replace(bent, expected_mm=self.expected_deformation_mm, unseen=free)
        return Assessed(pose, bent, probability)
