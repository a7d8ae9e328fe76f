"""Where a result might lie: a bootstrap where residuals are noise, their model where tissue has moved."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from threadpoolctl import threadpool_limits

from registration.rigid.acceptance import weak_motion
from registration.rigid.icp.robust_kernels import RobustKernel
from registration.rigid.pose_comparison import Evidence
from registration.rigid.residual_model.deformation import Deformation, predicted_tre_mm
from registration.rigid.residual_model.model import ResidualModel
from registration.rigid.smoothed_target import SmoothedTarget
from registration.rigid.uncertainty import Uncertainty, bootstrap_motions, local_fit

# The predicted error that is compared with the largest accepted one is exceeded in one case of twenty.
UPPER = 0.95
# Where points scatter by more than this share of the reach that normals are smoothed over, normals are wrong and the
# stiffness that the bootstrap takes from them is too; the model takes the scatter of its groups.
NOISY = 0.15


@dataclass(frozen=True)
class Prediction:
    """Pose of a result, and where it might lie.

    Parameters
    ----------
    fixed_T_moving : ndarray, shape (4, 4)
        Pose, corrected where tissue has moved.
    samples : ndarray, shape (b, 4, 4), or None
        Motions (fixed_T_fixed) to where the result might as well lie; None where nothing is predicted.
    expected_mm : float
        Upper end of the predicted error in mm; NaN where none is predicted.
    weakest : ndarray, shape (4, 4)
        Motion that is least held.
    deformation : Deformation or None, optional
        Deformation of tissue that the residuals show; None where nobody looked.
    probability_right_vessel : float, optional
        Probability that both clouds show one vessel; NaN where nobody looked.
    """

    fixed_T_moving: Float64[np.ndarray, "4 4"]
    samples: Float64[np.ndarray, "b 4 4"] | None
    expected_mm: float
    weakest: Float64[np.ndarray, "4 4"]
    deformation: Deformation | None = None
    probability_right_vessel: float = float("nan")


def predict(
    evidence: Evidence,
    fixed_T_moving: Float64[np.ndarray, "4 4"],
    places_mm: Float64[np.ndarray, "p 3"],
    rng: np.random.Generator,
    *,
    kernel: RobustKernel,
    uncertainty: Uncertainty,
    residual_model: ResidualModel | None,
    allowed: Callable[[Float64[np.ndarray, "4 4"]], bool] | None = None,
    seed: int = 0,
) -> Prediction:
    """Predict the error of a pose.

    Parameters
    ----------
    evidence : Evidence
        Moving points and the fixed cloud.
    fixed_T_moving : ndarray, shape (4, 4)
        Pose.
    places_mm : ndarray, shape (p, 3)
        Points of the fixed cloud in mm that the error is predicted at.
    rng : numpy.random.Generator
        Source of the bootstrap.
    kernel : RobustKernel
        Weights of the residuals in the bootstrap.
    uncertainty : Uncertainty
        Settings of the bootstrap.
    residual_model : ResidualModel or None
        Model of the residuals; None takes them all for noise.
    allowed : callable or None, optional
        Tells whether a corrected pose may be the result.
    seed : int, optional
        Seed of the draws from the model.

    Returns
    -------
    Prediction
        Pose and where it might lie.
    """
    if not isinstance(evidence.smoothed, SmoothedTarget):
        return Prediction(fixed_T_moving, None, float("nan"), np.eye(4))
    assessed = None
    if residual_model is not None:
        frame = None if evidence.frame is None else evidence.frame[: evidence.core]
        # Its matrices are small: threads of the linear algebra cost several times what they save.
        with threadpool_limits(1, user_api="blas"):
            assessed = residual_model(
                evidence.moving_mm[: evidence.core],
                evidence.smoothed,
                fixed_T_moving,
                places_mm,
                offset=evidence.offset,
                frame=frame,
                allowed=allowed,
                seed=seed,
            )
    pose = fixed_T_moving if assessed is None else assessed.fixed_T_moving
    bent = None if assessed is None else assessed.deformation
    reach_mm = evidence.smoothed.reach_mm
    if bent is not None and (bent.detected or bent.posterior.residuals.noise_mm > NOISY * reach_mm):
        motions_mm, move = bent.rigid_motions_mm(places_mm), bent.posterior.residuals.motions
    else:
        local = local_fit(
            evidence.moving_mm, evidence.smoothed, pose, evidence.block, kernel, evidence.offset
        )
        motions_mm = bootstrap_motions(local, uncertainty.replicates, uncertainty.inflation, rng)
        move = local.motions
    samples = move(motions_mm)
    return Prediction(
        pose,
        samples,
        float(np.quantile(predicted_tre_mm(places_mm, samples, bent), UPPER)),
        move(weak_motion(motions_mm)[None])[0],
        bent,
        float("nan") if assessed is None else assessed.probability_right_vessel,
    )
