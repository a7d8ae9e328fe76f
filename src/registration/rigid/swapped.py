"""A moving cloud that is longer than the fixed one: the search goes the other way, and its result is inverted."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Float64

from registration import transforms
from registration.geometry.shapes import principal_frame
from registration.rigid.fit import Fit
from registration.rigid.result import Candidate, RigidResult

# A cloud is longer than another if its spread along its own axis is this many times the other's.
LONGER = 1.25


def is_longer(one_mm: Float64[np.ndarray, "m 3"], other_mm: Float64[np.ndarray, "n 3"]) -> bool:
    """Tell whether one cloud reaches clearly farther along its principal axis than another, isolated points apart.

    Parameters
    ----------
    one_mm : ndarray, shape (m, 3)
        Points of the one in mm.
    other_mm : ndarray, shape (n, 3)
        Points of the other in mm.

    Returns
    -------
    bool
        Whether the one is longer.
    """
    return _reach_mm(one_mm) > LONGER * _reach_mm(other_mm)


def inverted_result(
    result: RigidResult,
    measure: Callable[[Candidate], Candidate],
    fit: Callable[[Float64[np.ndarray, "4 4"]], Fit],
    begin_s: float,
) -> RigidResult:
    """Turn the result of registering fixed to moving into that of moving to fixed.

    Poses are inverted, and with them the motions that say where the result might lie; residuals are measured anew.
    Verdict, gap and weak directions are the same both ways.

    Parameters
    ----------
    result : RigidResult
        Result with moving and fixed swapped.
    measure : callable
        Measures a candidate in the direction that was asked for.
    fit : callable
        Measures a pose in that direction.
    begin_s : float
        When the registration began, by ``time.perf_counter``.

    Returns
    -------
    RigidResult
        Result in the direction that was asked for.
    """
    pose = transforms.invert_rigid(result.fixed_T_moving)
    candidates = tuple(_inverted(one, measure) for one in result.candidates)
    residuals, best = fit(pose), candidates[0]
    samples, bent = result.pose_samples, result.deformation
    rival = result.rival_fixed_T_moving
    if samples is not None:
        samples = pose @ np.stack([transforms.invert_rigid(one) for one in samples]) @ result.fixed_T_moving
    return replace(
        result,
        fixed_T_moving=pose,
        rmse_mm=residuals.rmse_mm,
        rmse_trimmed_mm=residuals.rmse_trimmed_mm,
        inlier_share=residuals.inlier_share,
        candidates=candidates,
        rmse_bidirectional_mm=best.rmse_bidirectional_mm,
        coverage=best.coverage,
        rival_fixed_T_moving=None if rival is None else transforms.invert_rigid(rival),
        pose_samples=samples,
        # What the residuals say was said in the frame that was the fixed one there.
        deformation=None if bent is None else bent.seen_from(result.fixed_T_moving),
        wall_offset_mm=-result.wall_offset_mm,
        runtime_s=time.perf_counter() - begin_s,
    )


def _inverted(one: Candidate, measure: Callable[[Candidate], Candidate]) -> Candidate:
    start = one.start_fixed_T_moving
    turned = replace(
        one,
        fixed_T_moving=transforms.invert_rigid(one.fixed_T_moving),
        start_fixed_T_moving=None if start is None else transforms.invert_rigid(start),
    )
    return turned if np.isnan(one.coverage) else measure(turned)


def _reach_mm(points_mm: np.ndarray) -> float:
    """The median distance from the middle along the principal axis."""
    along_mm = points_mm @ principal_frame(points_mm).axes[:, 0]
    return float(np.median(np.abs(along_mm - np.median(along_mm))))
