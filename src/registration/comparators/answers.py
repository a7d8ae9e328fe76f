"""What a method that follows one pose hands back, and how one that searches everywhere has its pose refined."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Float64

from registration.correspondence import TreeTarget
from registration.errors import InputError
from registration.results import ACCEPTED, FAILED, Candidate, RigidResult, fit
from registration.search_cone import Bound, SearchCone
from registration.selection import both_ways


def one_answer(
    moving_mm: Float64[np.ndarray, "m 3"],
    target: TreeTarget,
    fixed_T_moving: Float64[np.ndarray, "4 4"],
    *,
    start: Float64[np.ndarray, "4 4"],
    keep: float,
    inlier_spacings: float,
    iterations: int,
    converged: bool,
    initial: Float64[np.ndarray, "4 4"] | None,
    search_cone: SearchCone | None,
    begin_s: float,
) -> RigidResult:
    """The result of a method that went from ``start`` to ``fixed_T_moving``, measured on all moving points.

    It has failed if it ended outside ``search_cone`` around ``initial``. ``begin_s`` is when the method began, by
    ``time.perf_counter``.
    """
    measured = fit(moving_mm, target, fixed_T_moving, keep=keep, inlier_spacings=inlier_spacings)
    both = both_ways(TreeTarget(moving_mm), target, fixed_T_moving, measured.rmse_mm, inlier_spacings)
    result = RigidResult(
        fixed_T_moving=fixed_T_moving,
        rmse_mm=measured.rmse_mm,
        rmse_trimmed_mm=measured.rmse_trimmed_mm,
        inlier_share=measured.inlier_share,
        iterations=iterations,
        converged=converged,
        candidates=(),
        runtime_s=time.perf_counter() - begin_s,
        rmse_bidirectional_mm=both.rmse_bidirectional_mm,
        coverage=both.coverage,
    )
    result = replace(result, candidates=(_only_candidate(result, start),))
    outside = _outside(moving_mm, fixed_T_moving, initial, search_cone)
    return replace(result, verdict=FAILED, reason=outside) if outside else result


def refined(
    found: Float64[np.ndarray, "4 4"] | None,
    refine: Callable[..., RigidResult],
    moving_mm: Float64[np.ndarray, "m 3"],
    fixed_mm: Float64[np.ndarray, "n 3"],
    initial: Float64[np.ndarray, "4 4"] | None,
    search_cone: SearchCone | None,
    begin_s: float,
) -> RigidResult:
    """Refine the pose ``found`` by a search everywhere and a known one beside it; the lower residual wins.

    One outside ``search_cone`` around ``initial`` cannot win. Raises InputError if there is nothing to refine: the
    search found no pose and none was known.
    """
    starts = [start for start in (found, initial) if start is not None]
    if not starts:
        raise InputError(
            "moving_mm: expected features that match those of fixed_mm, received none that agree on one pose"
        )
    results = [refine(moving_mm, fixed_mm, start) for start in starts]
    outside = [_outside(moving_mm, result.fixed_T_moving, initial, search_cone) for result in results]
    order = sorted(
        range(len(results)), key=lambda place: (bool(outside[place]), results[place].rmse_trimmed_mm)
    )
    best, reason = results[order[0]], outside[order[0]]
    return replace(
        best,
        iterations=sum(result.iterations for result in results),
        candidates=tuple(
            replace(results[place].candidates[0], basin=basin) for basin, place in enumerate(order)
        ),
        verdict=FAILED if reason else ACCEPTED,
        reason=reason or best.reason,
        runtime_s=time.perf_counter() - begin_s,
    )


def _only_candidate(result: RigidResult, start: np.ndarray) -> Candidate:
    return Candidate(
        result.fixed_T_moving,
        result.rmse_trimmed_mm,
        basin=0,
        starts=1,
        stage="fine",
        start_fixed_T_moving=start,
        rmse_trimmed_mm=result.rmse_trimmed_mm,
        rmse_bidirectional_mm=result.rmse_bidirectional_mm,
        inlier_share=result.inlier_share,
        coverage=result.coverage,
    )


def _outside(
    moving_mm: np.ndarray,
    fixed_T_moving: np.ndarray,
    initial: np.ndarray | None,
    search_cone: SearchCone | None,
) -> str:
    """Say how far outside the cone around ``initial`` the answer lies; nothing if it lies within, or there is none."""
    if initial is None or search_cone is None:
        return ""
    bound = Bound(initial, search_cone, moving_mm.mean(axis=0))
    if bound.holds(fixed_T_moving):
        return ""
    turn_deg, away_mm = bound.away(fixed_T_moving)
    return (
        f"the answer lies {turn_deg:.1f} degrees and {away_mm:.1f} mm from the initial pose, outside the search cone "
        f"of {search_cone.angle_deg:g} degrees and {search_cone.radius_mm:g} mm"
    )
