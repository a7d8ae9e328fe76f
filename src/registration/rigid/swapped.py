"""A moving cloud that is longer than the fixed one: the search goes the other way, and its result is inverted."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Float64

from registration import transforms
from registration.geometry.shapes import principal_frame
from registration.rigid.result import Candidate, Fit, RigidResult

# A cloud is longer than another if its spread along its own axis is this many times the other's.
LONGER = 1.25


def is_longer(one_mm: Float64[np.ndarray, "m 3"], other_mm: Float64[np.ndarray, "n 3"]) -> bool:
    """Whether one cloud reaches clearly farther along its principal axis than the other, isolated points apart."""
    return _reach_mm(one_mm) > LONGER * _reach_mm(other_mm)


def inverted_result(
    result: RigidResult,
    measure: Callable[[Candidate], Candidate],
    fit: Callable[[Float64[np.ndarray, "4 4"]], Fit],
    begin_s: float,
) -> RigidResult:
    """The result of registering fixed to moving as that of moving to fixed.

    Poses are inverted, and with them the motions that say where the result might lie. ``measure`` and ``fit`` take the
    residuals anew in the direction that was asked for; verdict, gap and weak directions are the same both ways.
    """
    pose = transforms.invert_rigid(result.fixed_T_moving)
    candidates = tuple(_inverted(one, measure) for one in result.candidates)
    residuals, best = fit(pose), candidates[0]
    samples = result.pose_samples
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
        pose_samples=samples,
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
