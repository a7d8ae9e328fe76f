"""From where a search ended to what it hands back: residuals both ways, weak directions, predicted error, verdict."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64

from registration import transforms
from registration.errors import InputError
from registration.geometry.shapes import PrincipalFrame, principal_frame
from registration.rigid.acceptance import (
    DIRECTIONS,
    AcceptanceCriteria,
    displacement_mm,
    named_motion,
    probes,
    weak_motion,
)
from registration.rigid.coarse_to_fine import EARLY_TOLERANCE, Found
from registration.rigid.icp.correspondence import TreeTarget
from registration.rigid.icp.loop import align
from registration.rigid.icp.robust_kernels import RobustKernel
from registration.rigid.pose_comparison import Evidence, both_ways
from registration.rigid.result import ACCEPTED, AMBIGUOUS, FAILED, Candidate, Fit, RigidResult, fit
from registration.rigid.search_cone import Bound
from registration.rigid.smoothed_target import SmoothedTarget
from registration.rigid.uncertainty import Uncertainty, bootstrap_motions, local_fit

# The result is slid along the vessel by so many accepted errors to see whether the clouds object.
PROBED_SLIDE = 1.5
PROBED_ITERATIONS = 6
# Rivals that are within so many standard errors of the best one are as good as it, and named with it.
ALIKE_GAPS = 2.0
# The error is predicted at this many points of the fixed cloud.
TARGETS = 300
# The predicted error that is compared with the largest accepted one is exceeded in one case of twenty.
UPPER = 0.95


@dataclass(frozen=True)
class Assessment:
    """Settings of the assessment of a result.

    Parameters
    ----------
    keep : float
        Share of closest points in the trimmed residual, above 0 to 1.
    inlier_spacings : float
        An inlier lies within so many distances between neighbouring points.
    kernel : RobustKernel
        Weights of the residuals around the pose.
    uncertainty : Uncertainty
        Bootstrap that predicts the error.
    acceptance : AcceptanceCriteria
        What a result must show to be accepted.
    probe_points : int
        Number of moving points on which the pose is slid and rolled to see whether the clouds object.
    seed : int
        Seed of the bootstrap and of the points that the error is predicted at.
    """

    keep: float
    inlier_spacings: float
    kernel: RobustKernel
    uncertainty: Uncertainty
    acceptance: AcceptanceCriteria
    probe_points: int
    seed: int

    def fit(
        self,
        moving_mm: Float64[np.ndarray, "m 3"],
        target: TreeTarget,
        fixed_T_moving: Float64[np.ndarray, "4 4"],
    ) -> Fit:
        """Measure the residuals of a pose.

        Parameters
        ----------
        moving_mm : ndarray, shape (m, 3)
            Moving points in mm.
        target : TreeTarget
            Fixed cloud.
        fixed_T_moving : ndarray, shape (4, 4)
            Pose.

        Returns
        -------
        Fit
            Residuals from the moving to the fixed points.
        """
        return fit(moving_mm, target, fixed_T_moving, keep=self.keep, inlier_spacings=self.inlier_spacings)

    def measured(
        self, one: Candidate, moving_mm: Float64[np.ndarray, "m 3"], moving: TreeTarget, target: TreeTarget
    ) -> Candidate:
        """Measure the residuals of a candidate both ways.

        Parameters
        ----------
        one : Candidate
            Candidate.
        moving_mm : ndarray, shape (m, 3)
            Moving points in mm.
        moving : TreeTarget
            Search index over the moving cloud.
        target : TreeTarget
            Search index over the fixed cloud.

        Returns
        -------
        Candidate
            The candidate with its residuals.
        """
        measured = self.fit(moving_mm, target, one.fixed_T_moving)
        both = both_ways(moving, target, one.fixed_T_moving, measured.rmse_mm, self.inlier_spacings)
        return replace(
            one,
            rmse_trimmed_mm=measured.rmse_trimmed_mm,
            rmse_bidirectional_mm=both.rmse_bidirectional_mm,
            inlier_share=measured.inlier_share,
            coverage=both.coverage,
        )


@dataclass(frozen=True)
class Problem:
    """What a search was asked.

    Parameters
    ----------
    moving_mm : ndarray, shape (m, 3)
        All moving points in mm.
    evidence : Evidence
        Moving points that poses are compared on, and the fixed cloud.
    bound : Bound or None
        Bound around a known pose; None where there is none.
    axes_tried : int
        Number of axes that were tried as the vessel's.
    begin_s : float
        When the registration began, by ``time.perf_counter``.
    """

    moving_mm: Float64[np.ndarray, "m 3"]
    evidence: Evidence
    bound: Bound | None
    axes_tried: int
    begin_s: float


def assess(settings: Assessment, problem: Problem, found: Found) -> RigidResult:
    """Assess the best candidate by its residuals, its local fit, the other poses, and what lies beyond the bound.

    Parameters
    ----------
    settings : Assessment
        Settings.
    problem : Problem
        What the search was asked.
    found : Found
        Where it ended.

    Returns
    -------
    RigidResult
        Pose, residuals, verdict and predicted error.

    Raises
    ------
    InputError
        If no start ended within the bound.
    """
    evidence, bound = problem.evidence, problem.bound
    if not found.candidates or not len(found.gap):
        raise InputError(
            "search_cone: expected a cone that holds a result, received one that no start ends in"
            + _best_end(found, bound)
        )
    candidates = _measured(settings, problem, found)
    best = candidates[0]
    pose = best.fixed_T_moving
    measured = settings.fit(problem.moving_mm, evidence.target, pose)
    rng = np.random.default_rng(settings.seed)
    places_mm = rng.permutation(evidence.target.points_mm, axis=0)[:TARGETS]
    spread = _spread(settings, evidence, pose, places_mm, rng)
    gap, directions = _left_open(settings, problem, found, spread, places_mm)
    verdict, reason = settings.acceptance(
        settled=found.settled,
        inlier_share=measured.inlier_share,
        gap=gap,
        expected_mm=spread.expected_mm,
        weak=directions,
        tries=problem.axes_tried,
    )
    verdict, reason = _within_bound(
        verdict, reason, bound, pose, _beyond(settings.acceptance.min_gap, evidence, found, bound, pose)
    )
    return RigidResult(
        fixed_T_moving=pose,
        rmse_mm=measured.rmse_mm,
        rmse_trimmed_mm=measured.rmse_trimmed_mm,
        inlier_share=measured.inlier_share,
        iterations=found.iterations,
        converged=found.settled and verdict != FAILED,
        candidates=candidates,
        runtime_s=time.perf_counter() - problem.begin_s,
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


def _measured(settings: Assessment, problem: Problem, found: Found) -> tuple[Candidate, ...]:
    """All candidates, those of the last stage with their residuals both ways."""
    moving = TreeTarget(problem.moving_mm)
    return tuple(
        replace(
            settings.measured(one, problem.moving_mm, moving, problem.evidence.target)
            if one.stage == "fine"
            else one,
            basin=basin,
        )
        for basin, one in enumerate(found.candidates)
    )


def _left_open(
    settings: Assessment, problem: Problem, found: Found, spread: _Spread, places_mm: np.ndarray
) -> tuple[float, tuple[str, ...]]:
    """By how many standard errors the next pose is worse, and the names of the motions that the clouds leave open."""
    criteria, evidence = settings.acceptance, problem.evidence
    frame = principal_frame(transforms.apply(found.candidates[0].fixed_T_moving, evidence.moving_mm))
    rivals = [
        (motion, gap)
        for motion, gap in _others(settings, evidence, found, frame)
        if displacement_mm(motion[None], places_mm)[0] > criteria.max_tre_mm
    ]
    gap = min((behind for _, behind in rivals), default=float("inf"))
    weak = []
    # Where several axes may be the vessel's, as many searches look for a pose that is better by chance.
    if gap < criteria.needed_gap(problem.axes_tried):
        weak = [motion for motion, behind in rivals if behind < gap + ALIKE_GAPS]
    if spread.expected_mm > criteria.max_tre_mm:
        weak.append(spread.weakest)
    names = {name for motion in weak for name in named_motion(motion, frame)}
    return gap, tuple(name for name in DIRECTIONS if name in names)


def _best_end(found: Found, bound: Bound | None) -> str:
    if bound is None or found.outside is None:
        return ""
    return f"; the best one ends {bound.describe(found.outside.fixed_T_moving)}"


def _beyond(min_gap: float, evidence: Evidence, found: Found, bound: Bound | None, pose: np.ndarray) -> str:
    """Say that a pose outside the bound explains the clouds better than the result by more than chance, if one does."""
    if bound is None or found.outside is None:
        return ""
    other = found.outside.fixed_T_moving
    behind = float(evidence.gaps(np.stack([other, pose]))[1])
    if behind < min_gap:
        return ""
    return f"a pose {bound.describe(other)}, explains the clouds better by {behind:.1f} standard errors"


def _within_bound(
    verdict: str, reason: str, bound: Bound | None, pose: np.ndarray, beyond: str
) -> tuple[str, str]:
    """The verdict on a result that was looked for near a known pose alone."""
    if bound is None:
        return verdict, reason
    if beyond:
        verdict, reason = (AMBIGUOUS, beyond) if verdict == ACCEPTED else (verdict, f"{reason}; {beyond}")
    edge = bound.at_edge(pose)
    return verdict, f"{reason}; {edge}" if edge else reason


@dataclass(frozen=True)
class _Spread:
    """Where the result might lie: poses as fixed_T_fixed, the error they predict, and the motion that is least held."""

    samples: np.ndarray | None
    expected_mm: float
    weakest: np.ndarray


def _spread(
    settings: Assessment,
    evidence: Evidence,
    pose: np.ndarray,
    places_mm: np.ndarray,
    rng: np.random.Generator,
) -> _Spread:
    if not isinstance(evidence.smoothed, SmoothedTarget):
        return _Spread(None, float("nan"), np.eye(4))
    local = local_fit(
        evidence.moving_mm, evidence.smoothed, pose, evidence.block, settings.kernel, evidence.offset
    )
    motions_mm = bootstrap_motions(
        local, settings.uncertainty.replicates, settings.uncertainty.inflation, rng
    )
    samples = local.motions(motions_mm)
    expected_mm = float(np.quantile(displacement_mm(samples, places_mm), UPPER))
    return _Spread(samples, expected_mm, local.motions(weak_motion(motions_mm)[None])[0])


def _others(
    settings: Assessment, evidence: Evidence, found: Found, frame: PrincipalFrame
) -> list[tuple[np.ndarray, float]]:
    """Where else the cloud might lie, as motions from the result, each with its gap in standard errors.

    The refined candidates of other basins, and the result slid and rolled as a vessel without features could be, and
    settled there: a vessel with features comes back.
    """
    pose = found.candidates[0].fixed_T_moving
    back = transforms.invert_rigid(pose)
    motions = [transforms.compose(one.fixed_T_moving, back) for one in found.candidates[: len(found.gap)]]
    settled = align(
        evidence.moving_mm[: settings.probe_points],
        evidence.target,
        probes(frame, PROBED_SLIDE * settings.acceptance.max_tre_mm) @ pose,
        max_iterations=PROBED_ITERATIONS,
        tolerance=EARLY_TOLERANCE,
        keep=settings.keep,
    ).fixed_T_moving
    gaps = evidence.gaps(np.concatenate([pose[None], settled]))[1:]
    return [*zip(motions, found.gap.tolist(), strict=True), *zip(settled @ back, gaps.tolist(), strict=True)]
