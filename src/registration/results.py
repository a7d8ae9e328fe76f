"""What a rigid registration hands back, whichever method made it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from numpy.typing import ArrayLike

from registration import frames
from registration.checks import require_positive
from registration.correspondence import TreeTarget
from registration.errors import InputError
from registration.geometry import require_points
from registration.rejection import trimming_weights
from registration.search_cone import SearchCone

ACCEPTED, AMBIGUOUS, FAILED = "accepted", "ambiguous", "failed"
# Of a method that cannot doubt itself: nothing is known of its answer.
NOT_JUDGED = "not judged"
VERDICTS = (ACCEPTED, AMBIGUOUS, FAILED, NOT_JUDGED)
UNJUDGED = "the method does not judge its answers"
# A length below this is rounding: no error of a registration is as small as that.
LEAST_SHOWN_MM = 1e-3


@dataclass(frozen=True)
class Candidate:
    """One pose that the search ended in.

    ``fixed_T_moving`` is rigid, in mm. ``rmse_mm`` is the trimmed residual it was ranked by, ``starts`` the number of
    starting poses that fell into its ``basin`` (numbered from 0 in the order of the list). ``stage`` is the last one
    it went through; residuals compare within a stage, not across. ``start_fixed_T_moving`` is the starting pose that
    led there, ``score_mm`` what the candidates of the last stage are chosen by; the scores after it are those of
    RigidResult. All of these are NaN or None where the method has none.
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


@dataclass(frozen=True, repr=False)
class RigidResult:
    """The answer of a rigid registration: ``fixed_T_moving`` (4, 4) maps moving to fixed coordinates, in mm.

    ``rmse_mm`` and ``rmse_trimmed_mm`` are residuals from every moving point, or from the closest share of them, to
    the nearest fixed point (so they fall as the fixed cloud grows denser; ``registration.metrics`` measures to
    triangles). ``inlier_share`` is the share of moving points within the method's inlier distance. ``iterations``
    counts the steps of all starts together. ``candidates`` come best first; the first is the answer.

    ``rmse_bidirectional_mm`` adds the way back from the fixed points that the moved cloud lies beside, and
    ``coverage`` is their share. ``verdict`` is ``accepted``, ``ambiguous`` or ``failed``, with the ``reason`` in one
    sentence, and ``not judged`` by a method that cannot doubt itself. ``ambiguity_gap`` is by how much the best
    candidate of another basin is worse, in standard errors; infinite if there is none, NaN if nobody looked.
    ``weak_directions`` names the motions that the clouds leave open (``slide``, ``roll``, ...). ``pose_samples``
    (b, 4, 4) are fixed_T_fixed, where the answer might as well lie; they carry the prediction of its error.
    ``wall_offset_mm`` is by how much the moved wall lies outside the fixed one everywhere, NaN if nobody looked.
    ``search_cone`` is the bound around a known pose that the method kept to, None without one.
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
    pose_samples: Float64[np.ndarray, "b 4 4"] | None = None
    wall_offset_mm: float = float("nan")
    search_cone: SearchCone | None = None

    def __post_init__(self) -> None:
        if self.verdict not in VERDICTS:
            raise InputError(f"verdict: expected one of {', '.join(VERDICTS)}, received {self.verdict!r}")

    def __repr__(self) -> str:
        """One screen: every number, and of poses and candidates what fits there."""
        pose = np.array2string(self.fixed_T_moving, precision=3, suppress_small=True, prefix=" " * 19)
        gap = "" if np.isnan(self.ambiguity_gap) else f", ambiguity_gap={self.ambiguity_gap:.1f}"
        weak = f", weak_directions={self.weak_directions}" if self.weak_directions else ""
        offset = "" if np.isnan(self.wall_offset_mm) else f", wall_offset_mm={self.wall_offset_mm:.3f}"
        samples = "none" if self.pose_samples is None else f"{len(self.pose_samples)}"
        return (
            f"RigidResult(verdict={self.verdict!r}, converged={self.converged}{gap}{weak},\n"
            f"    reason={self.reason!r},\n"
            f"    rmse_mm={self.rmse_mm:.4g}, rmse_trimmed_mm={self.rmse_trimmed_mm:.4g}, "
            f"rmse_bidirectional_mm={self.rmse_bidirectional_mm:.4g},\n"
            f"    inlier_share={self.inlier_share:.3f}, coverage={self.coverage:.3f}{offset},\n"
            f"    iterations={self.iterations}, runtime_s={self.runtime_s:.3g}, candidates={len(self.candidates)}, "
            f"pose_samples={samples},\n"
            f"    fixed_T_moving={pose})"
        )

    def tre_interval_mm(self, targets_mm: ArrayLike, level: float = 0.9) -> tuple[float, float]:
        """Where the target registration error at ``targets_mm`` (t, 3; fixed frame) lies with probability ``level``.

        What the tissue's deformation adds is not in it. Both ends are NaN for a method that does not predict its error.
        Raises InputError for no targets, targets that are no points, or a level outside 0 to 1.
        """
        targets = require_points(targets_mm, "targets_mm", 1)
        require_positive("level", level, 1.0)
        if self.pose_samples is None:
            return float("nan"), float("nan")
        moved_mm = targets @ np.swapaxes(self.pose_samples[:, :3, :3], 1, 2)
        moved_mm += self.pose_samples[:, None, :3, 3]
        errors_mm = np.sqrt(((moved_mm - targets) ** 2).sum(axis=2).mean(axis=1))
        low_mm, high_mm = np.quantile(errors_mm, [(1 - level) / 2, (1 + level) / 2])
        return float(low_mm), float(high_mm)


def verdict_sentence(result: RigidResult) -> str:
    """The verdict and its reason, as one sentence."""
    return f"Verdict: {result.verdict}, {result.reason}."


def length_mm(value_mm: float) -> str:
    """A length for a sentence: two digits that count, and never 0.0 for what is not."""
    if value_mm < LEAST_SHOWN_MM:
        return f"below {LEAST_SHOWN_MM:g} mm"
    return f"{value_mm:.1f} mm" if value_mm >= 1 else f"{value_mm:.2g} mm"


def predicted_sentence(low_mm: float, high_mm: float) -> str:
    """What a method predicts of its error, and what is not in it; nothing where it predicts none.

    Clouds without noise leave nothing to predict an error from.
    """
    if not (np.isfinite(low_mm) and np.isfinite(high_mm)):
        return ""
    if high_mm < LEAST_SHOWN_MM:
        return "No TRE is predicted: the clouds fit each other without noise."
    return (
        f"Predicted TRE {length_mm(low_mm)} to {length_mm(high_mm)} (90 %); what the tissue's deformation adds is not "
        "included."
    )


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
