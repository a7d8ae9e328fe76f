"""What a rigid registration hands back, whichever method made it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from registration import frames
from registration.checks import require_positive
from registration.correspondence import TreeTarget
from registration.errors import InputError
from registration.rejection import trimming_weights

ACCEPTED, AMBIGUOUS, FAILED = "accepted", "ambiguous", "failed"
VERDICTS = (ACCEPTED, AMBIGUOUS, FAILED)


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


@dataclass(frozen=True)
class RigidResult:
    """The answer of a rigid registration: ``fixed_T_moving`` (4, 4) maps moving to fixed coordinates, in mm.

    ``rmse_mm`` and ``rmse_trimmed_mm`` are residuals from every moving point, or from the closest share of them, to
    the nearest fixed point (so they fall as the fixed cloud grows denser; ``registration.metrics`` measures to
    triangles). ``inlier_share`` is the share of moving points within the method's inlier distance. ``iterations``
    counts the steps of all starts together. ``candidates`` come best first; the first is the answer.

    ``rmse_bidirectional_mm`` adds the way back from the fixed points that the moved cloud lies beside, and
    ``coverage`` is their share. ``verdict`` is ``accepted``, ``ambiguous`` or ``failed``, with the ``reason`` in one
    sentence; a method that cannot doubt itself accepts every answer. ``ambiguity_gap`` is by how much the best
    candidate of another basin is worse, in standard errors; infinite if there is none, NaN if nobody looked.
    ``weak_directions`` names the motions that the clouds leave open (``slide``, ``roll``, ...). ``pose_samples``
    (b, 4, 4) are fixed_T_fixed, where the answer might as well lie; they carry the prediction of its error.
    ``wall_offset_mm`` is by how much the moved wall lies outside the fixed one everywhere, NaN if nobody looked.
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
    verdict: str = ACCEPTED
    reason: str = "the method does not judge its answers"
    ambiguity_gap: float = float("nan")
    weak_directions: tuple[str, ...] = ()
    pose_samples: Float64[np.ndarray, "b 4 4"] | None = None
    wall_offset_mm: float = float("nan")

    def __post_init__(self) -> None:
        if self.verdict not in VERDICTS:
            raise InputError(f"verdict: expected one of {', '.join(VERDICTS)}, received {self.verdict!r}")

    def tre_interval_mm(
        self, targets_mm: Float64[np.ndarray, "t 3"], level: float = 0.9
    ) -> tuple[float, float]:
        """Where the target registration error at ``targets_mm`` (fixed frame) lies with probability ``level``.

        Both ends are NaN for a method that does not predict its error. Raises InputError for no targets or a level
        outside 0 to 1.
        """
        if not len(targets_mm) or not np.isfinite(targets_mm).all():
            raise InputError(
                f"targets_mm: expected finite targets, received {len(targets_mm)} with NaN or none"
            )
        require_positive("level", level, 1.0)
        if self.pose_samples is None:
            return float("nan"), float("nan")
        moved_mm = targets_mm @ np.swapaxes(self.pose_samples[:, :3, :3], 1, 2)
        moved_mm += self.pose_samples[:, None, :3, 3]
        errors_mm = np.sqrt(((moved_mm - targets_mm) ** 2).sum(axis=2).mean(axis=1))
        low_mm, high_mm = np.quantile(errors_mm, [(1 - level) / 2, (1 + level) / 2])
        return float(low_mm), float(high_mm)


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
