"""The search of a multi-start registration: many starts on few points, the survivors on more, coarse to fine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64

from registration.rigid.icp.correspondence import Target, TreeTarget, VoxelTarget
from registration.rigid.icp.estimation import Estimation, PointToPlane, PointToPoint, Symmetric
from registration.rigid.icp.loop import Alignments, align
from registration.rigid.icp.rejection import Rejection
from registration.rigid.icp.robust_kernels import RobustKernel
from registration.rigid.pose_comparison import Evidence, distinct
from registration.rigid.result import Candidate
from registration.rigid.search_cone import Bound

# Poses are told apart by what they do to this many points of the cloud.
BASIN_POINTS = 64
# Far from the result a step along normals is damped by this share of the mean stiffness.
COARSE_DAMPING = 0.01
# The early stages need not settle: the next one goes on from where they are.
EARLY_TOLERANCE = 1e-3
# A candidate of the middle stage that is this many standard errors behind the best has no chance left.
HOPELESS_GAP = 6.0


@dataclass(frozen=True)
class Stage:
    """How far one stage takes its poses.

    Parameters
    ----------
    name : str
        Name of the stage.
    points : int
        Number of moving points.
    iterations : int
        Largest number of iterations.
    tolerance : float
        Relative change of the residual below which a pose has settled.
    max_survivors : int
        Number of poses that go on; unused in the first stage, where a share of the starts does.
    """

    name: str
    points: int
    iterations: int
    tolerance: float
    max_survivors: int


@dataclass(frozen=True)
class Found:
    """Where a search ended.

    Parameters
    ----------
    candidates : tuple of Candidate
        Poses, best first.
    gap : ndarray, shape (c,)
        By how many standard errors the first c of them, the refined ones, explain the clouds worse than the best.
    iterations : int
        Iterations of all starts together.
    outside : Candidate or None, optional
        Best pose beyond the bound of the search, which is no candidate; None where there is none.
    """

    candidates: tuple[Candidate, ...]
    gap: Float64[np.ndarray, " c"]
    iterations: int
    outside: Candidate | None = None

    @property
    def settled(self) -> bool:
        """Whether the best pose has settled."""
        return self.candidates[0].settled

    def with_best(self, fixed_T_moving: Float64[np.ndarray, "4 4"]) -> Found:
        """Return the same with another pose for the best candidate.

        Parameters
        ----------
        fixed_T_moving : ndarray, shape (4, 4)
            Pose.

        Returns
        -------
        Found
            Where the search ended.
        """
        best = replace(self.candidates[0], fixed_T_moving=fixed_T_moving)
        return replace(self, candidates=(best, *self.candidates[1:]))


@dataclass(frozen=True)
class CoarseToFine:
    """Search that takes starting poses to the few that explain the clouds best.

    Parameters
    ----------
    first, coarse : Stage
        Early stages: closest points from a table, point-to-plane steps where there are normals.
    middle, fine : Stage
        Late stages: exact closest points.
    first_share : float
        Share of the starts that survives the first stage.
    cells : int
        Voxels a side of the table.
    keep : float
        Share of closest pairs that counts in the early stages.
    kept : float
        Share of closest pairs that counts in the late stages.
    basin_share : float
        Poses that move the cloud alike within this share of its radius are one.
    estimation : Estimation
        Step of the late stages.
    kernel : RobustKernel or None
        Weights of the pairs of the late stages; None weighs them alike.
    rejections : sequence of Rejection
        Rules by which more pairs of the late stages do not count.
    """

    first: Stage
    coarse: Stage
    middle: Stage
    fine: Stage
    first_share: float
    cells: int
    keep: float
    kept: float
    basin_share: float
    estimation: Estimation
    kernel: RobustKernel | None
    rejections: Sequence[Rejection]

    def __call__(
        self,
        evidence: Evidence,
        starts: Float64[np.ndarray, "s 4 4"],
        within: Bound | None = None,
        moving_normals: Float64[np.ndarray, "m 3"] | None = None,
    ) -> Found:
        """Search from all starting poses.

        Parameters
        ----------
        evidence : Evidence
            Both clouds; the moving points are in random order, and a stage takes the first ones.
        starts : ndarray, shape (s, 4, 4)
            Starting poses (fixed_T_moving).
        within : Bound or None, optional
            Bound that no candidate lies outside of, so that there may be none. The best pose outside is followed
            all the same, for it may explain the clouds better than any candidate does. None bounds nothing.
        moving_normals : ndarray, shape (m, 3), or None, optional
            Normals of the moving points, for steps and rules that need them.

        Returns
        -------
        Found
            Where the search ended.
        """
        pool, steps = self._coarse(evidence, starts)
        pool, beyond = _divided(pool, within)
        near, far = pool[: self.coarse.max_survivors], pool[self.coarse.max_survivors :]
        middle, more = self._refined(evidence, near + beyond[:1], self.middle, moving_normals)
        middle, beyond = _divided(middle, within)
        hopeful = [
            one for one, gap in zip(middle, _gaps(evidence, middle), strict=True) if gap < HOPELESS_GAP
        ]
        chosen = hopeful[: self.middle.max_survivors]
        fine, last = self._refined(evidence, chosen + beyond[:1], self.fine, moving_normals)
        fine, beyond = _divided(fine, within)
        names = {id(one) for one in chosen}
        left = [one for one in middle if id(one) not in names]
        return Found(
            candidates=tuple(fine + left + far),
            gap=_gaps(evidence, fine + left),
            iterations=steps + more + last,
            outside=next(iter(beyond), None),
        )

    def refined(
        self,
        evidence: Evidence,
        one: Candidate,
        within: Bound | None = None,
        moving_normals: Float64[np.ndarray, "m 3"] | None = None,
    ) -> tuple[Candidate | None, int]:
        """Take a pose through the last stage.

        Parameters
        ----------
        evidence : Evidence
            Both clouds.
        one : Candidate
            Pose.
        within : Bound or None, optional
            Bound that the pose must stay in.
        moving_normals : ndarray, shape (m, 3), or None, optional
            Normals of the moving points.

        Returns
        -------
        pose : Candidate or None
            Where it ended; None if that is beyond the bound.
        iterations : int
            Number of iterations.
        """
        found, steps = self._refined(evidence, [one], self.fine, moving_normals)
        return next(iter(_divided(found, within)[0]), None), steps

    def _coarse(self, evidence: Evidence, starts: np.ndarray) -> tuple[list[Candidate], int]:
        """Both early stages: candidates of different basins, the ones dropped after the first stage last."""
        target = evidence.target
        table = VoxelTarget(target.points_mm, self.cells, exact=target)
        step = PointToPoint() if target.normals is None else PointToPlane(COARSE_DAMPING)
        first = self._aligned(evidence, table, starts, self.first, step)
        order = np.argsort(first.rmse_mm, kind="stable")
        count = max(int(np.ceil(self.first_share * len(starts))), min(self.coarse.max_survivors, len(starts)))
        kept, dropped = order[:count], order[count:]
        coarse = self._aligned(evidence, table, first.fixed_T_moving[kept], self.coarse, step)
        ranks = np.argsort(coarse.rmse_mm, kind="stable")
        poses = np.concatenate([coarse.fixed_T_moving[ranks], first.fixed_T_moving[dropped]])
        residuals_mm = np.concatenate([coarse.rmse_mm[ranks], first.rmse_mm[dropped]])
        origins = starts[np.concatenate([kept[ranks], dropped])]
        groups = distinct(poses, evidence.moving_mm[:BASIN_POINTS], self.reach_mm(evidence))
        found = [
            _candidate(
                poses[group[0]],
                float(residuals_mm[group[0]]),
                self.coarse.name if group[0] < count else self.first.name,
                len(group),
                origins[group[0]],
            )
            for group in groups
        ]
        return found, int(first.iterations.sum() + coarse.iterations.sum())

    def _refined(
        self,
        evidence: Evidence,
        chosen: list[Candidate],
        stage: Stage,
        moving_normals: np.ndarray | None,
    ) -> tuple[list[Candidate], int]:
        """Exact closest points from the chosen poses on: best first, and the number of steps."""
        if not chosen:
            return [], 0
        poses = np.stack([one.fixed_T_moving for one in chosen])
        found = self._aligned(
            evidence, evidence.target, poses, stage, self.estimation, self.kernel, moving_normals
        )
        scores_mm = np.sqrt(evidence.bounded_mm2(found.fixed_T_moving).mean(axis=1))
        order = np.argsort(scores_mm, kind="stable")
        groups = distinct(
            found.fixed_T_moving[order], evidence.moving_mm[:BASIN_POINTS], self.reach_mm(evidence)
        )
        merged = [
            _candidate(
                found.fixed_T_moving[order[group[0]]],
                float(scores_mm[order[group[0]]]),
                stage.name,
                sum(chosen[order[member]].starts for member in group),
                chosen[order[group[0]]].start_fixed_T_moving,
                settled=bool(found.converged[order[group[0]]]),
            )
            for group in groups
        ]
        return merged, int(found.iterations.sum())

    def _aligned(
        self,
        evidence: Evidence,
        target: Target,
        poses: np.ndarray,
        stage: Stage,
        estimation: Estimation,
        kernel: RobustKernel | None = None,
        moving_normals: np.ndarray | None = None,
    ) -> Alignments:
        exact = isinstance(target, TreeTarget)
        return align(
            evidence.moving_mm[: stage.points],
            target,
            poses,
            keep=self.kept if exact else self.keep,
            max_iterations=stage.iterations,
            tolerance=stage.tolerance,
            estimation=estimation,
            kernel=kernel,
            rejections=self.rejections if exact else (),
            moving_normals=None if moving_normals is None else moving_normals[: stage.points],
        )

    def reach_mm(self, evidence: Evidence) -> float:
        """Compute within what distance two poses move the cloud alike.

        Parameters
        ----------
        evidence : Evidence
            Both clouds.

        Returns
        -------
        float
            Root mean square distance in mm.
        """
        return self.basin_share * float(np.sqrt(evidence.moving_mm.var(axis=0).sum()))


def estimation_by(refine_by: str, offset: bool) -> Estimation:
    """Choose the step of the late stages by its name in the configuration.

    Parameters
    ----------
    refine_by : str
        ``plane``, ``symmetric`` or ``point``.
    offset : bool
        Whether the walls may lie apart by the same distance everywhere.

    Returns
    -------
    Estimation
        The step.
    """
    steps: dict[str, Estimation] = {
        "plane": PointToPlane(offset=offset),
        "symmetric": Symmetric(offset=offset),
        "point": PointToPoint(),
    }
    return steps[refine_by]


def _candidate(
    pose: np.ndarray,
    score_mm: float,
    stage: str,
    starts: int,
    start: np.ndarray | None,
    *,
    settled: bool = False,
) -> Candidate:
    return Candidate(
        fixed_T_moving=pose,
        rmse_mm=score_mm,
        basin=0,
        starts=starts,
        stage=stage,
        start_fixed_T_moving=start,
        score_mm=score_mm,
        settled=settled,
    )


def _divided(candidates: list[Candidate], within: Bound | None) -> tuple[list[Candidate], list[Candidate]]:
    """Those within a bound and those beyond it, in their order."""
    held = [within is None or within.holds(one.fixed_T_moving) for one in candidates]
    inside = [one for one, is_held in zip(candidates, held, strict=True) if is_held]
    return inside, [one for one, is_held in zip(candidates, held, strict=True) if not is_held]


def _gaps(evidence: Evidence, candidates: list[Candidate]) -> Float64[np.ndarray, " c"]:
    if not candidates:
        return np.zeros(0)
    return evidence.gaps(np.stack([one.fixed_T_moving for one in candidates]))
