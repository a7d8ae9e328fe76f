"""From where a search ended to what it hands back: residuals both ways, weak directions, predicted error, verdict."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64

from registration.errors import InputError
from registration.rigid.acceptance import AcceptanceCriteria
from registration.rigid.coarse_to_fine import Found
from registration.rigid.fit import Fit, fit
from registration.rigid.icp.correspondence import TreeTarget
from registration.rigid.icp.robust_kernels import RobustKernel
from registration.rigid.open_motions import OpenMotions, left_open
from registration.rigid.pose_comparison import Evidence, both_ways
from registration.rigid.prediction import Prediction, predict
from registration.rigid.residual_model.model import ResidualModel
from registration.rigid.result import ACCEPTED, AMBIGUOUS, FAILED, Candidate, RigidResult
from registration.rigid.search_cone import Bound
from registration.rigid.uncertainty import Uncertainty

# The error is predicted at this many points of the fixed cloud.
TARGETS = 300


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
        Bootstrap that predicts the error where no tissue has moved.
    residual_model : ResidualModel or None
        Model of the residuals; None takes them all for noise.
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
    residual_model: ResidualModel | None
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
    seen_share : float or None, optional
        Share of the moving points that a search for partial overlap found in view of the fixed cloud, and ``evidence``
        is of these; None for a search for the whole cloud.
    """

    moving_mm: Float64[np.ndarray, "m 3"]
    evidence: Evidence
    bound: Bound | None
    axes_tried: int
    begin_s: float
    seen_share: float | None = None


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
    rng = np.random.default_rng(settings.seed)
    places_mm = rng.permutation(evidence.target.points_mm, axis=0)[:TARGETS]
    allowed = None if bound is None else bound.holds
    predicted = predict(
        evidence,
        found.candidates[0].fixed_T_moving,
        places_mm,
        rng,
        kernel=settings.kernel,
        uncertainty=settings.uncertainty,
        residual_model=settings.residual_model,
        allowed=allowed,
        seed=settings.seed,
    )
    return _result(settings, problem, found.with_best(predicted.fixed_T_moving), predicted, places_mm)


def _result(
    settings: Assessment,
    problem: Problem,
    found: Found,
    predicted: Prediction,
    places_mm: Float64[np.ndarray, "t 3"],
) -> RigidResult:
    """The result at the predicted pose, which is that of the best candidate."""
    pose = predicted.fixed_T_moving
    candidates = _measured(settings, problem, found)
    measured = settings.fit(problem.moving_mm, problem.evidence.target, pose)
    left = left_open(
        settings.acceptance,
        problem.axes_tried,
        problem.evidence,
        found,
        predicted,
        places_mm,
        probe_points=settings.probe_points,
        keep=settings.keep,
        over_all=problem.seen_share is not None,
    )
    verdict, reason = _verdict(settings, problem, found, predicted, measured.inlier_share, left)
    return RigidResult(
        fixed_T_moving=pose,
        rmse_mm=measured.rmse_mm,
        rmse_trimmed_mm=measured.rmse_trimmed_mm,
        inlier_share=measured.inlier_share,
        iterations=found.iterations,
        converged=found.settled and verdict != FAILED,
        candidates=candidates,
        runtime_s=time.perf_counter() - problem.begin_s,
        rmse_bidirectional_mm=candidates[0].rmse_bidirectional_mm,
        coverage=candidates[0].coverage,
        verdict=verdict,
        reason=reason,
        ambiguity_gap=left.gap,
        weak_directions=left.directions,
        rival_fixed_T_moving=left.rival,
        overlap_share=float("nan") if problem.seen_share is None else problem.seen_share,
        pose_samples=predicted.samples,
        wall_offset_mm=problem.evidence.wall_offset_mm(pose),
        search_cone=None if problem.bound is None else problem.bound.kept_to,
        deformation=predicted.deformation,
        probability_right_vessel=predicted.probability_right_vessel,
    )


def _verdict(
    settings: Assessment,
    problem: Problem,
    found: Found,
    predicted: Prediction,
    inlier_share: float,
    left: OpenMotions,
) -> tuple[str, str]:
    """Verdict with its reason, within the bound where there is one."""
    if problem.seen_share is not None:
        seen_mm, target = problem.evidence.moving_mm, problem.evidence.target
        inlier_share = settings.fit(seen_mm, target, predicted.fixed_T_moving).inlier_share
    verdict, reason = settings.acceptance(
        settled=found.settled,
        inlier_share=inlier_share,
        gap=left.gap,
        expected_mm=predicted.expected_mm,
        weak=left.directions,
        tries=problem.axes_tried,
        deformation=predicted.deformation,
        probability_right_vessel=predicted.probability_right_vessel,
    )
    if problem.seen_share is not None and verdict == ACCEPTED:
        verdict = AMBIGUOUS
        reason = (
            "it was found as a partial overlap, and a part may fit other places and other vessels as well"
        )
    bound, pose = problem.bound, predicted.fixed_T_moving
    beyond = _beyond(settings.acceptance.min_gap, problem.evidence, found, bound, pose)
    return _within_bound(verdict, reason, bound, pose, beyond)


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
