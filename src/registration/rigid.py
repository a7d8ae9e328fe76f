"""Symmetry-aware multi-start rigid registration of two clouds, coarse to fine."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64
from scipy.spatial.distance import cdist

from registration import frames
from registration.checks import require_count, require_positive
from registration.errors import InputError
from registration.geometry import require_cloud
from registration.icp import Alignments, Target, TreeTarget, VoxelTarget, align
from registration.results import Candidate, RigidResult, fit
from registration.starts import cone_starts, symmetry_starts

# Poses are told apart by what they do to this many points of the cloud.
BASIN_POINTS = 64


@dataclass(frozen=True)
class MultiStartICP:
    """ICP from every pose that the symmetry of a vessel allows; the lowest trimmed residual wins.

    Starts: principal axes laid on each other, rolled in ``rolls`` equal steps, inverted, and slid along the vessel in
    steps of ``slide_share`` of the moving cloud's length; an axis with ``axis_share`` of the longest one's spread
    counts as principal too. All of them take ``coarse_iterations`` on ``coarse_points`` against a closest-point table
    of ``coarse_cells`` voxels; the best ``survivors`` of different basins go on with ``middle_points`` and exact
    closest points, the best ``finalists`` of those with up to ``fine_points``. A pose is in the basin of a better one
    if both move the cloud alike within ``basin_share`` of its radius.

    ``refine_by`` is the residual of the last two stages and of the ranking: ``plane`` (along normals estimated from
    ``neighbours`` points: exact on sampled surfaces, whose points never coincide) or ``point`` (for clouds that are
    no surface, such as centerlines). ``keep`` is the share of closest pairs that counts. ``cone_deg`` bounds the
    search around a given initial pose. Deterministic in ``seed``, which draws the points of the early stages.

    Methods: T. Vantini, Politecnico di Milano, 2025, section 2.5 (starts and selection); see ``registration.icp``.

    >>> vessel_mm = np.random.default_rng(1).normal(size=(500, 3)) * [9.0, 3.0, 1.0]
    >>> bool(MultiStartICP()(vessel_mm + 5.0, vessel_mm).rmse_mm < 1e-6)
    True
    """

    rolls: int = 12
    slide_share: float = 0.25
    axis_share: float = 0.75
    coarse_points: int = 300
    coarse_cells: int = 64
    coarse_iterations: int = 25
    survivors: int = 8
    middle_points: int = 600
    finalists: int = 2
    fine_points: int = 5000
    max_iterations: int = 50
    tolerance: float = 1e-4
    keep: float = 0.9
    refine_by: str = "plane"
    neighbours: int = 20
    basin_share: float = 0.1
    cone_deg: float = 45.0
    inlier_spacings: float = 3.0
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("rolls", "coarse_iterations", "survivors", "finalists", "max_iterations"):
            require_count(name, getattr(self, name), 1)
        for name in ("coarse_points", "middle_points", "fine_points", "neighbours"):
            require_count(name, getattr(self, name), 3)
        require_count("coarse_cells", self.coarse_cells, 8)
        require_count("seed", self.seed, 0)
        for name in ("slide_share", "axis_share", "tolerance", "keep", "basin_share"):
            require_positive(name, getattr(self, name), 1.0)
        require_positive("cone_deg", self.cone_deg, 180.0)
        require_positive("inlier_spacings", self.inlier_spacings)
        if self.refine_by not in ("plane", "point"):
            raise InputError(f"refine_by: expected plane or point, received {self.refine_by!r}")

    def __call__(
        self,
        moving_mm: Float64[np.ndarray, "m 3"],
        fixed_mm: Float64[np.ndarray, "n 3"],
        initial: Float64[np.ndarray, "4 4"] | None = None,
    ) -> RigidResult:
        """Register ``moving_mm`` to ``fixed_mm`` from anywhere, or from near ``initial`` (a fixed_T_moving).

        Raises InputError for a cloud that is empty, not finite or degenerate, or an ``initial`` that is not rigid.
        """
        begin_s = time.perf_counter()
        require_cloud(moving_mm, "moving_mm")
        require_cloud(fixed_mm, "fixed_mm")
        if initial is None:
            starts = symmetry_starts(moving_mm, fixed_mm, self.rolls, self.slide_share, self.axis_share)
        else:
            starts = cone_starts(moving_mm, frames.require_rigid(initial, "initial"), self.cone_deg)
        shuffled_mm = np.random.default_rng(self.seed).permutation(moving_mm, axis=0)
        target = TreeTarget(fixed_mm, self.neighbours if self.refine_by == "plane" else 0)
        candidates, iterations, converged = self._search(shuffled_mm, fixed_mm, target, starts)
        pose = candidates[0].fixed_T_moving
        measured = fit(moving_mm, target, pose, keep=self.keep, inlier_spacings=self.inlier_spacings)
        return RigidResult(
            fixed_T_moving=pose,
            rmse_mm=measured.rmse_mm,
            rmse_trimmed_mm=measured.rmse_trimmed_mm,
            inlier_share=measured.inlier_share,
            iterations=iterations,
            converged=converged,
            candidates=candidates,
            runtime_s=time.perf_counter() - begin_s,
        )

    def _search(
        self, shuffled_mm: np.ndarray, fixed_mm: np.ndarray, target: TreeTarget, starts: np.ndarray
    ) -> tuple[tuple[Candidate, ...], int, bool]:
        """Take the starts through the three stages: candidates best first, steps, whether the best settled."""
        table = VoxelTarget(fixed_mm, self.coarse_cells)
        coarse = self._stage(shuffled_mm[: self.coarse_points], table, starts, self.coarse_iterations, 1e-3)
        pool = self._basins(shuffled_mm, coarse, np.ones(len(starts), dtype=np.int64), "coarse")
        ranked: list[Candidate] = []
        steps, settled = int(coarse.iterations.sum()), True
        for stage, count, points, tolerance in (
            ("middle", self.survivors, self.middle_points, max(self.tolerance, 1e-3)),
            ("fine", self.finalists, self.fine_points, self.tolerance),
        ):
            chosen, rest = pool[:count], pool[count:]
            poses = np.stack([candidate.fixed_T_moving for candidate in chosen])
            refined = self._stage(shuffled_mm[:points], target, poses, self.max_iterations, tolerance)
            weights = np.array([candidate.starts for candidate in chosen])
            pool = self._basins(shuffled_mm, refined, weights, stage)
            ranked = rest + ranked
            steps += int(refined.iterations.sum())
            settled = bool(refined.converged[int(refined.rmse_mm.argmin())])
        return tuple(replace(found, basin=basin) for basin, found in enumerate(pool + ranked)), steps, settled

    def _stage(
        self, points_mm: np.ndarray, target: Target, starts: np.ndarray, iterations: int, tolerance: float
    ) -> Alignments:
        return align(
            points_mm, target, starts, keep=self.keep, max_iterations=iterations, tolerance=tolerance
        )

    def _basins(
        self, shuffled_mm: np.ndarray, found: Alignments, starts: np.ndarray, stage: str
    ) -> list[Candidate]:
        """Merge poses that move the cloud alike, the better one standing for both; best first."""
        probe_mm = shuffled_mm[:BASIN_POINTS]
        reach_mm = self.basin_share * float(np.sqrt(shuffled_mm.var(axis=0).sum()))
        poses = found.fixed_T_moving
        places_mm = probe_mm @ np.swapaxes(poses[:, :3, :3], 1, 2) + poses[:, None, :3, 3]
        flat_mm = places_mm.reshape(len(poses), -1)
        near = cdist(flat_mm, flat_mm) <= reach_mm * np.sqrt(len(probe_mm))
        merged: list[Candidate] = []
        free = np.ones(len(poses), dtype=bool)
        for index in np.argsort(found.rmse_mm, kind="stable"):
            if free[index]:
                members = near[index] & free
                free &= ~members
                merged.append(
                    Candidate(
                        fixed_T_moving=poses[index],
                        rmse_mm=float(found.rmse_mm[index]),
                        basin=len(merged),
                        starts=int(starts[members].sum()),
                        stage=stage,
                    )
                )
        return merged
