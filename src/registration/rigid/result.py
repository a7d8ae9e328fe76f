"""What a rigid registration hands back, whichever method made it."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from numpy.typing import ArrayLike

from registration import transforms
from registration.brief import COLUMNS, brief_repr
from registration.checks import require_positive
from registration.errors import InputError
from registration.geometry.pictures import Overlay, Stage
from registration.geometry.shapes import require_points
from registration.rigid.residual_model.deformation import Deformation, predicted_tre_mm
from registration.rigid.search_cone import SearchCone

ACCEPTED, AMBIGUOUS, FAILED = "accepted", "ambiguous", "failed"
# Of a method that cannot doubt itself: nothing is known of its result.
NOT_JUDGED = "not judged"
VERDICTS = (ACCEPTED, AMBIGUOUS, FAILED, NOT_JUDGED)
UNJUDGED = "the method does not assess its results"
# A length below this is rounding: no error of a registration is as small as that.
MIN_SHOWN_MM = 1e-3


@dataclass(frozen=True)
class Candidate:
    """One pose that a search ended in.

    Parameters
    ----------
    fixed_T_moving : ndarray, shape (4, 4)
        Rigid pose, in mm.
    rmse_mm : float
        Trimmed residual in mm that it was ranked by; it compares within a stage, not across.
    basin : int
        Its number in the order of the list, from 0.
    starts : int
        Number of starting poses that fell into its basin.
    stage : str
        Last stage that it went through.
    start_fixed_T_moving : ndarray, shape (4, 4), or None, optional
        Starting pose that led there.
    score_mm : float, optional
        What the candidates of the last stage are chosen by, in mm; NaN where the method has none, as below.
    rmse_trimmed_mm : float, optional
        Root mean square distance in mm from the closest share of the moving points.
    rmse_bidirectional_mm : float, optional
        Root mean square distance in mm both ways.
    inlier_share : float, optional
        Share of moving points within the inlier distance.
    coverage : float, optional
        Share of fixed points that the moved cloud covers.
    settled : bool, optional
        Whether its last stage had settled when the iterations ran out.
    """

    fixed_T_moving: Float64[np.ndarray, "4 4"]
    rmse_mm: float
    basin: int
    starts: int
    stage: str
    start_fixed_T_moving: Float64[np.ndarray, "4 4"] | None = None
    score_mm: float = float("nan")
    rmse_trimmed_mm: float = float("nan")
    rmse_bidirectional_mm: float = float("nan")
    inlier_share: float = float("nan")
    coverage: float = float("nan")
    settled: bool = False

    __repr__ = brief_repr


@dataclass(frozen=True, repr=False)
class RigidResult:
    """Result of a rigid registration.

    Parameters
    ----------
    fixed_T_moving : ndarray, shape (4, 4)
        Pose that maps moving to fixed coordinates, in mm.
    rmse_mm : float
        Root mean square distance in mm from every moving point to the nearest fixed point. It falls as the fixed cloud
        grows denser; ``registration.metrics`` measures to triangles.
    rmse_trimmed_mm : float
        The same from the closest share of the moving points.
    inlier_share : float
        Share of moving points within the method's inlier distance.
    iterations : int
        Iterations of all starts together.
    converged : bool
        Whether the pose has settled.
    candidates : tuple of Candidate
        Poses, best first; the first is the result.
    runtime_s : float
        Duration in s.
    rmse_bidirectional_mm : float, optional
        Root mean square distance in mm both ways, back from the fixed points that the moved cloud lies next to.
    coverage : float, optional
        Share of fixed points that the moved cloud covers.
    verdict : str, optional
        ``accepted``, ``ambiguous`` or ``failed``; ``not judged`` by a method that does not assess its results.
    reason : str, optional
        Reason of the verdict in one sentence.
    ambiguity_gap : float, optional
        Standard errors by which the best candidate of another basin is worse; infinite if there is none, NaN if nobody
        looked.
    weak_directions : tuple of str, optional
        Names of the motions that the clouds leave open (``slide``, ``roll``, ...).
    rival_fixed_T_moving : ndarray, shape (4, 4), or None, optional
        The other pose that explains the clouds best, by which the gap is; None where there is none or nobody looked.
    overlap_share : float, optional
        Share of the moving points (of the fixed ones where the clouds were swapped) beside the other cloud, of a result
        found as a partial overlap; its predicted error is that of these points. NaN for a result of the search for the
        whole cloud.
    pose_samples : ndarray, shape (b, 4, 4), or None, optional
        Motions (fixed_T_fixed) to where the result might as well lie; they carry the prediction of its error.
    wall_offset_mm : float, optional
        By how much the moved wall lies outside the fixed one everywhere, in mm; NaN if nobody looked.
    search_cone : SearchCone or None, optional
        Bound around a known pose that the method kept to; None without one.
    deformation : Deformation or None, optional
        Deformation of tissue that the residuals show or do not show; None where nobody looked.
    probability_right_vessel : float, optional
        Probability that both clouds show one vessel, and neither its mirror image; NaN where nobody looked.

    Raises
    ------
    InputError
        If the verdict is none of the four.
    """

    fixed_T_moving: Float64[np.ndarray, "4 4"]
    rmse_mm: float
    rmse_trimmed_mm: float
    inlier_share: float
    iterations: int
    converged: bool
    candidates: tuple[Candidate, ...]
    runtime_s: float
    rmse_bidirectional_mm: float = float("nan")
    coverage: float = float("nan")
    verdict: str = NOT_JUDGED
    reason: str = UNJUDGED
    ambiguity_gap: float = float("nan")
    weak_directions: tuple[str, ...] = ()
    rival_fixed_T_moving: Float64[np.ndarray, "4 4"] | None = None
    overlap_share: float = float("nan")
    pose_samples: Float64[np.ndarray, "b 4 4"] | None = None
    wall_offset_mm: float = float("nan")
    search_cone: SearchCone | None = None
    deformation: Deformation | None = None
    probability_right_vessel: float = float("nan")

    def __post_init__(self) -> None:
        if self.verdict not in VERDICTS:
            raise InputError(f"verdict: expected one of {', '.join(VERDICTS)}, received {self.verdict!r}")

    def __repr__(self) -> str:
        """One screen: every number, and of poses and candidates what fits there."""
        pose = np.array2string(self.fixed_T_moving, precision=3, suppress_small=True, prefix=" " * 19)
        gap = "" if np.isnan(self.ambiguity_gap) else f", ambiguity_gap={self.ambiguity_gap:.1f}"
        weak = f",\n    weak_directions={self.weak_directions}" if self.weak_directions else ""
        offset = "" if np.isnan(self.wall_offset_mm) else f", wall_offset_mm={self.wall_offset_mm:.3f}"
        bent = ""
        if self.deformation is not None:
            bent = (
                f"{_filled(f'deformation={self.deformation}')},\n"
                f"    probability_right_vessel={self.probability_right_vessel:.3f},\n"
            )
        samples = "none" if self.pose_samples is None else f"{len(self.pose_samples)}"
        return (
            f"RigidResult(verdict={self.verdict!r}, converged={self.converged}{gap}{weak},\n"
            f"{_filled(f'reason={self.reason!r}')},\n"
            f"    rmse_mm={self.rmse_mm:.4g}, rmse_trimmed_mm={self.rmse_trimmed_mm:.4g}, "
            f"rmse_bidirectional_mm={self.rmse_bidirectional_mm:.4g},\n"
            f"    inlier_share={self.inlier_share:.3f}, coverage={self.coverage:.3f}{offset},\n"
            f"{bent}    iterations={self.iterations}, runtime_s={self.runtime_s:.3g}, "
            f"candidates={len(self.candidates)}, pose_samples={samples},\n"
            f"    fixed_T_moving={pose})"
        )

    def overlay(self, moving_mm: ArrayLike, fixed_mm: ArrayLike) -> Overlay:
        """Lay one cloud on the other, before and after; a notebook shows it as a picture by distance.

        Parameters
        ----------
        moving_mm : ndarray, shape (n, 3)
            Moving cloud in mm.
        fixed_mm : ndarray, shape (m, 3)
            Fixed cloud in mm.

        Returns
        -------
        Overlay
            Two stages: the centres of both laid on each other, and this pose.

        Raises
        ------
        InputError
            If a point is none.
        """
        moving, fixed = require_points(moving_mm, "moving_mm", 1), require_points(fixed_mm, "fixed_mm", 1)
        centred = moving - moving.mean(axis=0) + fixed.mean(axis=0)
        after = transforms.apply(self.fixed_T_moving, moving)
        return Overlay((Stage("centres on each other", centred, fixed), Stage("after", after, fixed)))

    def tre_interval_mm(self, targets_mm: ArrayLike, level: float = 0.9) -> tuple[float, float]:
        """Predict where the target registration error lies.

        Where tissue was found to have moved, the error is the distance between the targets and their material as it
        was swept, and holds what no rigid pose undoes; elsewhere what deformation adds is not in it.

        Parameters
        ----------
        targets_mm : ndarray, shape (t, 3)
            Target points in mm in the fixed coordinate frame.
        level : float, optional
            Probability that the error lies in the interval, above 0 to 1.

        Returns
        -------
        low_mm : float
            Lower end in mm; NaN for a method that does not predict its error.
        high_mm : float
            Upper end in mm; NaN likewise.

        Raises
        ------
        InputError
            If there is no target, a target is no point, or the level is outside 0 to 1.
        """
        targets = require_points(targets_mm, "targets_mm", 1)
        require_positive("level", level, 1.0)
        if self.pose_samples is None:
            return float("nan"), float("nan")
        errors_mm = predicted_tre_mm(targets, self.pose_samples, self.deformation)
        low_mm, high_mm = np.quantile(errors_mm, [(1 - level) / 2, (1 + level) / 2])
        return float(low_mm), float(high_mm)


def verdict_sentence(result: RigidResult) -> str:
    """Write the verdict and its reason as one sentence.

    Parameters
    ----------
    result : RigidResult
        Result.

    Returns
    -------
    str
        The sentence.
    """
    return f"Verdict: {result.verdict}, {result.reason}."


def length_mm(value_mm: float) -> str:
    """Write a length for a sentence: two significant digits, and never 0.0 for what is not.

    Parameters
    ----------
    value_mm : float
        Length in mm.

    Returns
    -------
    str
        Length with its unit.
    """
    if value_mm < MIN_SHOWN_MM:
        return f"below {MIN_SHOWN_MM:g} mm"
    return f"{value_mm:.1f} mm" if value_mm >= 1 else f"{value_mm:.2g} mm"


def percent(probability: float) -> str:
    """Write a probability for a sentence, in percent; none is called certain.

    Parameters
    ----------
    probability : float
        Probability, 0 to 1.

    Returns
    -------
    str
        Whole percent with the sign; "less than 1 %" and "over 99 %" at the ends.

    Examples
    --------
    >>> percent(0.874), percent(1.0), percent(0.004)
    ('87 %', 'over 99 %', 'less than 1 %')
    """
    if probability < 0.01:
        return "less than 1 %"
    return "over 99 %" if probability > 0.99 else f"{100 * probability:.0f} %"


def predicted_sentence(low_mm: float, high_mm: float, deformation: Deformation | None = None) -> str:
    """Write what a method predicts of its error, and whether the motion of tissue is in it.

    Parameters
    ----------
    low_mm : float
        Lower end of the predicted error in mm.
    high_mm : float
        Upper end in mm.
    deformation : Deformation or None, optional
        Deformation that the residuals show; None where nobody looked.

    Returns
    -------
    str
        The sentence; empty where no error is predicted. Clouds without noise leave nothing to predict it from.
    """
    if not (np.isfinite(low_mm) and np.isfinite(high_mm)):
        return ""
    if high_mm < MIN_SHOWN_MM:
        return "No TRE is predicted: the clouds fit each other without noise."
    predicted = f"Predicted TRE {length_mm(low_mm)} to {length_mm(high_mm)} (90 %)"
    if deformation is None:
        return f"{predicted}; what the tissue's deformation adds is not included."
    if deformation.unseen is not None:
        predicted += f" with an expected tissue motion of {length_mm(deformation.expected_mm)}"
    if deformation.detected:
        return f"{predicted}, tissue motion of about {length_mm(deformation.size_mm)} detected."
    if deformation.unseen is not None:
        return f"{predicted}, none detected."
    return f"{predicted}, no tissue motion detected; motion that the surfaces do not show is not included."


def _filled(text: str) -> str:
    """Lines of one screen's width, the first indented as the others of the result, what follows further."""
    return textwrap.fill(
        text, COLUMNS - 2, initial_indent="    ", subsequent_indent=" " * 8, break_on_hyphens=False
    )
