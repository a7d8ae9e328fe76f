"""How well a pose fits: distances from the moved points to the nearest fixed ones, on all of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from registration import transforms
from registration.rigid.icp.correspondence import TreeTarget
from registration.rigid.icp.rejection import trimming_weights


@dataclass(frozen=True)
class Fit:
    """How well a pose brings a moving cloud onto the nearest points of a fixed one.

    Parameters
    ----------
    rmse_mm : float
        Root mean square distance in mm.
    rmse_trimmed_mm : float
        The same over the closest share of the points.
    inlier_share : float
        Share of moving points within the inlier distance.
    """

    rmse_mm: float
    rmse_trimmed_mm: float
    inlier_share: float


def fit(
    moving_mm: Float64[np.ndarray, "m 3"],
    target: TreeTarget,
    fixed_T_moving: Float64[np.ndarray, "4 4"],
    *,
    keep: float,
    inlier_spacings: float,
) -> Fit:
    """Measure a pose on all moving points.

    Parameters
    ----------
    moving_mm : ndarray, shape (m, 3)
        Moving points in mm.
    target : TreeTarget
        Fixed cloud.
    fixed_T_moving : ndarray, shape (4, 4)
        Pose.
    keep : float
        Share of closest points in the trimmed residual.
    inlier_spacings : float
        An inlier lies within so many times the median distance between neighbouring fixed points.

    Returns
    -------
    Fit
        Residuals.
    """
    moved_mm = transforms.apply(fixed_T_moving, moving_mm)
    squared = ((target.points_mm[target.closest(moved_mm)] - moved_mm) ** 2).sum(axis=1)
    weights = trimming_weights(squared[None], keep)[0]
    return Fit(
        rmse_mm=float(np.sqrt(squared.mean())),
        rmse_trimmed_mm=float(np.sqrt((weights * squared).sum() / weights.sum())),
        inlier_share=float((squared <= (inlier_spacings * target.spacing_mm) ** 2).mean()),
    )
