"""What a method that follows one pose hands back, and how one that searches everywhere has its pose refined."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Float64

from registration.errors import InputError
from registration.rigid.fit import fit
from registration.rigid.icp.correspondence import TreeTarget
from registration.rigid.pose_comparison import both_ways
from registration.rigid.result import FAILED, NOT_JUDGED, UNJUDGED, Candidate, RigidResult
from registration.rigid.search_cone import UNBOUNDED, Bound, SearchCone, bound_around


def single_result(
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
    """Assemble the result of a method that follows one pose, measured on all moving points.

    It has failed if it ended outside the bound around a known pose; its pose is then the one on the bound.

    Parameters
    ----------
    moving_mm : ndarray, shape (m, 3)
        Moving points in mm.
    target : TreeTarget
        Fixed cloud.
    fixed_T_moving : ndarray, shape (4, 4)
        Pose that the method ended in.
    start : ndarray, shape (4, 4)
        Pose that it began from.
    keep : float
        Share of closest points in the trimmed residual.
    inlier_spacings : float
        An inlier lies within so many distances between neighbouring points.
    iterations : int
        Number of iterations.
    converged : bool
        Whether the method settled.
    initial : ndarray, shape (4, 4), or None
        Known pose; None where there is none.
    search_cone : SearchCone or None
        Bound around it; None stands for the default one.
    begin_s : float
        When the method began, by ``time.perf_counter``.

    Returns
    -------
    RigidResult
        Result with one candidate.
    """
    bound = bound_around(initial, search_cone, moving_mm)
    reason = _of_bound(bound, fixed_T_moving)
    outside = bound is not None and not bound.holds(fixed_T_moving)
    if bound is not None:
        fixed_T_moving = bound.held(fixed_T_moving)
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
    return replace(
        result,
        candidates=(_only_candidate(result, start),),
        verdict=FAILED if outside else NOT_JUDGED,
        reason=reason or result.reason,
        search_cone=None if bound is None else bound.kept_to,
    )


def refined(
    found: Float64[np.ndarray, "4 4"] | None,
    refine: Callable[..., RigidResult],
    moving_mm: Float64[np.ndarray, "m 3"],
    fixed_mm: Float64[np.ndarray, "n 3"],
    initial: Float64[np.ndarray, "4 4"] | None,
    search_cone: SearchCone | None,
    begin_s: float,
) -> RigidResult:
    """Refine the pose of a search everywhere and a known one; the lower residual wins.

    A pose outside the bound around the known one cannot win; where both are, the search has failed, in the pose on the
    bound.

    Parameters
    ----------
    found : ndarray, shape (4, 4), or None
        Pose (fixed_T_moving) that the search found; None if it found none.
    refine : callable
        Method that follows one pose.
    moving_mm : ndarray, shape (m, 3)
        Moving points in mm.
    fixed_mm : ndarray, shape (n, 3)
        Fixed points in mm.
    initial : ndarray, shape (4, 4), or None
        Known pose; None where there is none.
    search_cone : SearchCone or None
        Bound around it; None stands for the default one.
    begin_s : float
        When the method began, by ``time.perf_counter``.

    Returns
    -------
    RigidResult
        The better result, with both as candidates.

    Raises
    ------
    InputError
        If the search found no pose and none was known.
    """
    results = [] if found is None else [refine(moving_mm, fixed_mm, found, search_cone=UNBOUNDED)]
    if initial is not None:
        results.append(refine(moving_mm, fixed_mm, initial, search_cone=search_cone))
    if not results:
        raise InputError(
            "moving_mm: expected features that match those of fixed_mm, received none that agree on one pose"
        )
    bound = bound_around(initial, search_cone, moving_mm)
    # The known pose's own refinement never is outside: it fails there.
    order = sorted(
        results,
        key=lambda one: (
            bound is not None and not bound.holds(one.fixed_T_moving),
            one.verdict == FAILED,
            one.rmse_trimmed_mm,
        ),
    )
    best = order[0]
    return replace(
        best,
        iterations=sum(result.iterations for result in results),
        candidates=tuple(replace(one.candidates[0], basin=basin) for basin, one in enumerate(order)),
        reason=best.reason
        if best.verdict == FAILED
        else _of_bound(bound, best.fixed_T_moving) or best.reason,
        search_cone=None if bound is None else bound.kept_to,
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


def _of_bound(bound: Bound | None, fixed_T_moving: np.ndarray) -> str:
    """Say that a method that does not judge ended outside the bound or at it; nothing elsewhere, or without one."""
    if bound is None:
        return ""
    if not bound.holds(fixed_T_moving):
        return f"the method ended {bound.describe(fixed_T_moving)}; the pose handed back lies on its border"
    edge = bound.at_edge(fixed_T_moving)
    return f"{UNJUDGED}, and {edge}" if edge else ""
