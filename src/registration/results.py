"""What a rigid registration hands back, whichever method made it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from registration import frames
from registration.icp import TreeTarget, trimming_weights


@dataclass(frozen=True)
class Candidate:
    """One pose that the search ended in.

    ``fixed_T_moving`` is rigid, in mm. ``rmse_mm`` is the trimmed residual it was ranked by, ``starts`` the number of
    starting poses that fell into its ``basin`` (numbered from 0 in the order of the list). ``stage`` is the last one
    it went through; residuals compare within a stage, not across.
    """

    fixed_T_moving: Float64[np.ndarray, "4 4"]
    rmse_mm: float
    basin: int
    starts: int
    stage: str


@dataclass(frozen=True)
class RigidResult:
    """The answer of a rigid registration: ``fixed_T_moving`` (4, 4) maps moving to fixed coordinates, in mm.

    ``rmse_mm`` and ``rmse_trimmed_mm`` are residuals from every moving point, or from the closest share of them, to
    the nearest fixed point (so they fall as the fixed cloud grows denser; ``registration.metrics`` measures to
    triangles). ``inlier_share`` is the share of moving points within the method's inlier distance. ``iterations``
    counts the steps of all starts together. ``candidates`` come best first; the first is the answer.
    """

    fixed_T_moving: Float64[np.ndarray, "4 4"]
    rmse_mm: float
    rmse_trimmed_mm: float
    inlier_share: float
    iterations: int
    converged: bool
    candidates: tuple[Candidate, ...]
    runtime_s: float


@dataclass(frozen=True)
class Fit:
    """How well a pose brings a moving cloud onto the nearest points of a fixed one."""

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

    ``keep`` is the share of closest points in the trimmed residual; an inlier is within ``inlier_spacings`` times the
    median distance between neighbouring fixed points.
    """
    moved_mm = frames.apply(fixed_T_moving, moving_mm)
    squared = ((target.points_mm[target.closest(moved_mm)] - moved_mm) ** 2).sum(axis=1)
    weights = trimming_weights(squared[None], keep)[0]
    return Fit(
        rmse_mm=float(np.sqrt(squared.mean())),
        rmse_trimmed_mm=float(np.sqrt((weights * squared).sum() / weights.sum())),
        inlier_share=float((squared <= (inlier_spacings * target.spacing_mm) ** 2).mean()),
    )
