"""Which motions the clouds leave open: other poses that explain them as well, and the motion that is least held."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from registration import transforms
from registration.geometry.shapes import PrincipalFrame, principal_frame
from registration.rigid.acceptance import (
    DIRECTIONS,
    AcceptanceCriteria,
    displacement_mm,
    named_motion,
    probes,
)
from registration.rigid.coarse_to_fine import EARLY_TOLERANCE, Found
from registration.rigid.icp.loop import align
from registration.rigid.pose_comparison import Evidence
from registration.rigid.prediction import Prediction

# The result is slid along the vessel by so many accepted errors to see whether the clouds object.
PROBED_SLIDE = 1.5
PROBED_ITERATIONS = 6
# Rivals that are within so many standard errors of the best one are as good as it, and named with it.
ALIKE_GAPS = 2.0


@dataclass(frozen=True)
class OpenMotions:
    """What the clouds leave open.

    Parameters
    ----------
    gap : float
        Standard errors by which the next pose is worse; infinite where there is none.
    directions : tuple of str
        Names of the motions.
    rival : ndarray, shape (4, 4), or None
        That next pose (fixed_T_moving).
    """

    gap: float
    directions: tuple[str, ...]
    rival: Float64[np.ndarray, "4 4"] | None


def left_open(
    criteria: AcceptanceCriteria,
    axes_tried: int,
    evidence: Evidence,
    found: Found,
    predicted: Prediction,
    places_mm: Float64[np.ndarray, "p 3"],
    *,
    probe_points: int,
    keep: float,
    over_all: bool = False,
) -> OpenMotions:
    """Find by how much the next pose is worse, and which motions the clouds leave open.

    Parameters
    ----------
    criteria : AcceptanceCriteria
        What a result must show to be accepted.
    axes_tried : int
        Number of axes that were tried as the vessel's.
    evidence : Evidence
        Moving points and the fixed cloud.
    found : Found
        Where the search ended, the result first.
    predicted : Prediction
        Where the result might lie.
    places_mm : ndarray, shape (p, 3)
        Points of the fixed cloud in mm.
    probe_points : int
        Number of moving points on which the result is slid and rolled.
    keep : float
        Share of closest pairs that counts then.
    over_all : bool, optional
        Whether the gaps of the search are over more points than ``evidence`` has: a part of the points knows too
        little of poses that bring another part onto the surface.

    Returns
    -------
    OpenMotions
        The next pose, and the motions by name.
    """
    pose = found.candidates[0].fixed_T_moving
    frame = principal_frame(transforms.apply(pose, evidence.moving_mm))
    others = _others(criteria, evidence, found, frame, probe_points, keep)
    if over_all:
        known = zip(others, found.gap[1:], strict=False)
        refined = [(other, min(behind, float(gap))) for (other, behind), gap in known]
        others = [*refined, *others[len(refined) :]]
    back = transforms.invert_rigid(pose)
    motions = [transforms.compose(other, back) for other, _ in others]
    far = [displacement_mm(motion[None], places_mm)[0] > criteria.max_tre_mm for motion in motions]
    rivals = [
        (motion, _gap(predicted, evidence, other, behind), other)
        for motion, (other, behind), is_far in zip(motions, others, far, strict=True)
        if is_far
    ]
    _, gap, rival = min(rivals, key=lambda one: one[1], default=(None, float("inf"), None))
    weak = []
    # Where several axes may be the vessel's, as many searches look for a pose that is better by chance.
    if gap < criteria.needed_gap(axes_tried):
        weak = [motion for motion, behind, _ in rivals if behind < gap + ALIKE_GAPS]
    if predicted.expected_mm > criteria.max_tre_mm:
        weak.append(predicted.weakest)
    names = {name for motion in weak for name in named_motion(motion, frame)}
    return OpenMotions(gap, tuple(name for name in DIRECTIONS if name in names), rival)


def _gap(predicted: Prediction, evidence: Evidence, other: np.ndarray, behind: float) -> float:
    """The gap of another pose; where tissue has moved, under the covariance that its motion gives the residuals."""
    if predicted.deformation is None or not predicted.deformation.detected:
        return behind
    frame = None if evidence.frame is None else evidence.frame[: evidence.core]
    under = predicted.deformation.gap_of(
        other, evidence.moving_mm[: evidence.core], evidence.smoothed, offset=evidence.offset, frame=frame
    )
    return min(behind, under)


def _others(
    criteria: AcceptanceCriteria,
    evidence: Evidence,
    found: Found,
    frame: PrincipalFrame,
    probe_points: int,
    keep: float,
) -> list[tuple[np.ndarray, float]]:
    """Where else the cloud might lie, each pose with its gap in standard errors.

    The refined candidates of other basins, and the result slid and rolled as a vessel without features could be, and
    settled there: a vessel with features comes back.
    """
    pose = found.candidates[0].fixed_T_moving
    refined = [one.fixed_T_moving for one in found.candidates[1 : len(found.gap)]]
    settled = align(
        evidence.moving_mm[:probe_points],
        evidence.target,
        probes(frame, PROBED_SLIDE * criteria.max_tre_mm) @ pose,
        max_iterations=PROBED_ITERATIONS,
        tolerance=EARLY_TOLERANCE,
        keep=keep,
    ).fixed_T_moving
    others = [*refined, *settled]
    return list(zip(others, evidence.gaps(np.stack([pose, *others]))[1:].tolist(), strict=True))
