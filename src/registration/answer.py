"""From where a search ended to what it hands back: residuals both ways, weak directions, predicted error, verdict."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float64

from registration import frames
from registration.ambiguity import DIRECTIONS, displacement_mm, named_motion, probes, weak_motion
from registration.correspondence import TreeTarget
from registration.errors import InputError
from registration.geometry import PrincipalFrame, principal_frame
from registration.icp import align
from registration.results import ACCEPTED, AMBIGUOUS, FAILED, Candidate, RigidResult, fit
from registration.robust_kernels import Tukey
from registration.search import EARLY_TOLERANCE, Found
from registration.search_cone import Bound
from registration.selection import Evidence, both_ways
from registration.smoothed_target import SmoothedTarget
from registration.uncertainty import bootstrap_motions, local_fit

if TYPE_CHECKING:
    from registration.rigid import MultiStartICP

# The answer is slid along the vessel by so many tolerated errors to see whether the clouds object.
PROBED_SLIDE = 1.5
PROBED_ITERATIONS = 6
# Rivals that are within so many standard errors of the best one are as good as it, and named beside it.
ALIKE_GAPS = 2.0
# The error is predicted at this many points of the fixed cloud.
TARGETS = 300
# The predicted error that is compared with the tolerated one is exceeded in one case of twenty.
UPPER = 0.95


def answer(
    method: MultiStartICP,
    moving_mm: Float64[np.ndarray, "m 3"],
    evidence: Evidence,
    found: Found,
    bound: Bound | None,
    begin_s: float,
) -> RigidResult:
    """Judge the best candidate by the others, by its local fit, by its residuals, and by what lies beyond the bound."""
    if not found.candidates or not len(found.gap):
        raise InputError(
            "search_cone: expected a cone that holds an answer, received one that no start ends in"
            + _best_end(found, bound)
        )
    target = evidence.target
    moving = TreeTarget(moving_mm)
    candidates = tuple(
        replace(
            measured_candidate(method, one, moving_mm, moving, target) if one.stage == "fine" else one,
            basin=basin,
        )
        for basin, one in enumerate(found.candidates)
    )
    best = candidates[0]
    pose = best.fixed_T_moving
    measured = fit(moving_mm, target, pose, keep=method.kept, inlier_spacings=method.inlier_spacings)
    rng = np.random.default_rng(method.seed)
    places_mm = rng.permutation(target.points_mm, axis=0)[:TARGETS]
    spread = _spread(method, evidence, pose, places_mm, rng)
    frame = principal_frame(frames.apply(pose, evidence.moving_mm))
    rivals = [
        (motion, gap)
        for motion, gap in _others(method, evidence, found, frame)
        if displacement_mm(motion[None], places_mm)[0] > method.judge.tolerated_mm
    ]
    gap = min((behind for _, behind in rivals), default=float("inf"))
    weak = []
    # Where several axes may be the vessel's, as many searches look for a pose that is better by chance.
    tries = method.axes_tried(evidence) if bound is None else 1
    if gap < method.judge.needed_gap(tries):
        weak = [motion for motion, behind in rivals if behind < gap + ALIKE_GAPS]
    if spread.expected_mm > method.judge.tolerated_mm:
        weak.append(spread.weakest)
    names = {name for motion in weak for name in named_motion(motion, frame)}
    directions = tuple(name for name in DIRECTIONS if name in names)
    verdict, reason = method.judge(
        settled=found.settled,
        inlier_share=measured.inlier_share,
        gap=gap,
        expected_mm=spread.expected_mm,
        weak=directions,
        tries=tries,
    )
    verdict, reason = _within_bound(
        verdict, reason, bound, pose, _beyond(method, evidence, found, bound, pose)
    )
    return RigidResult(
        fixed_T_moving=pose,
        rmse_mm=measured.rmse_mm,
        rmse_trimmed_mm=measured.rmse_trimmed_mm,
        inlier_share=measured.inlier_share,
        iterations=found.iterations,
        converged=found.settled and verdict != FAILED,
        candidates=candidates,
        runtime_s=time.perf_counter() - begin_s,
        rmse_bidirectional_mm=best.rmse_bidirectional_mm,
        coverage=best.coverage,
        verdict=verdict,
        reason=reason,
        ambiguity_gap=gap,
        weak_directions=directions,
        pose_samples=spread.samples,
        wall_offset_mm=evidence.wall_offset_mm(pose),
        search_cone=None if bound is None else bound.kept_to,
    )


def _best_end(found: Found, bound: Bound | None) -> str:
    if bound is None or found.outside is None:
        return ""
    return f"; the best one ends {bound.describe(found.outside.fixed_T_moving)}"


def _beyond(
    method: MultiStartICP, evidence: Evidence, found: Found, bound: Bound | None, pose: np.ndarray
) -> str:
    """Say that a pose outside the bound explains the clouds better than the answer by more than chance, if one does."""
    if bound is None or found.outside is None:
        return ""
    other = found.outside.fixed_T_moving
    behind = float(evidence.gaps(np.stack([other, pose]))[1])
    if behind < method.judge.least_gap:
        return ""
    return f"a pose {bound.describe(other)}, explains the clouds better by {behind:.1f} standard errors"


def _within_bound(
    verdict: str, reason: str, bound: Bound | None, pose: np.ndarray, beyond: str
) -> tuple[str, str]:
    """The verdict on an answer that was looked for near a known pose alone."""
    if bound is None:
        return verdict, reason
    if beyond:
        verdict, reason = (AMBIGUOUS, beyond) if verdict == ACCEPTED else (verdict, f"{reason}; {beyond}")
    edge = bound.at_edge(pose)
    return verdict, f"{reason}; {edge}" if edge else reason


@dataclass(frozen=True)
class _Spread:
    """Where the answer might lie: poses as fixed_T_fixed, the error they predict, and the motion that is least held."""

    samples: np.ndarray | None
    expected_mm: float
    weakest: np.ndarray


def _spread(
    method: MultiStartICP,
    evidence: Evidence,
    pose: np.ndarray,
    places_mm: np.ndarray,
    rng: np.random.Generator,
) -> _Spread:
    if not isinstance(evidence.smoothed, SmoothedTarget):
        return _Spread(None, float("nan"), np.eye(4))
    local = local_fit(
        evidence.moving_mm, evidence.smoothed, pose, evidence.block, method.kernel or Tukey(), evidence.offset
    )
    motions_mm = bootstrap_motions(local, method.replicates, method.inflation, rng)
    samples = local.motions(motions_mm)
    expected_mm = float(np.quantile(displacement_mm(samples, places_mm), UPPER))
    return _Spread(samples, expected_mm, local.motions(weak_motion(motions_mm)[None])[0])


def measured_candidate(
    method: MultiStartICP, one: Candidate, moving_mm: np.ndarray, moving: TreeTarget, target: TreeTarget
) -> Candidate:
    """A candidate with its residuals both ways."""
    measured = fit(
        moving_mm, target, one.fixed_T_moving, keep=method.kept, inlier_spacings=method.inlier_spacings
    )
    both = both_ways(moving, target, one.fixed_T_moving, measured.rmse_mm, method.inlier_spacings)
    return replace(
        one,
        rmse_trimmed_mm=measured.rmse_trimmed_mm,
        rmse_bidirectional_mm=both.rmse_bidirectional_mm,
        inlier_share=measured.inlier_share,
        coverage=both.coverage,
    )


def _others(
    method: MultiStartICP, evidence: Evidence, found: Found, frame: PrincipalFrame
) -> list[tuple[np.ndarray, float]]:
    """Where else the cloud might lie, as motions from the answer, each with its gap in standard errors.

    The refined candidates of other basins, and the answer slid and rolled as a vessel without features could be, and
    settled there: a vessel with features comes back.
    """
    pose = found.candidates[0].fixed_T_moving
    back = frames.invert_rigid(pose)
    motions = [frames.compose(one.fixed_T_moving, back) for one in found.candidates[: len(found.gap)]]
    settled = align(
        evidence.moving_mm[: method.coarse_points],
        evidence.target,
        probes(frame, PROBED_SLIDE * method.judge.tolerated_mm) @ pose,
        max_iterations=PROBED_ITERATIONS,
        tolerance=EARLY_TOLERANCE,
        keep=method.kept,
    ).fixed_T_moving
    gaps = evidence.gaps(np.concatenate([pose[None], settled]))[1:]
    return [*zip(motions, found.gap.tolist(), strict=True), *zip(settled @ back, gaps.tolist(), strict=True)]
