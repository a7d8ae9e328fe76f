"""Rigid methods that multi-start registration is compared with, behind the same call."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from registration import frames
from registration.checks import require_count, require_positive
from registration.geometry import require_cloud
from registration.icp import TreeTarget, align
from registration.results import Candidate, RigidResult, fit


@dataclass(frozen=True)
class SingleStartICP:
    """Point-to-point ICP from one pose (Besl and McKay, IEEE PAMI 14(2), 1992), as it is commonly run.

    ``align_centroids`` first brings the centroids together. ``keep`` is the share of closest pairs that counts in
    each step. It stops once the residual changes by less than ``tolerance`` of itself, or after ``max_iterations``.
    """

    align_centroids: bool = False
    keep: float = 1.0
    max_iterations: int = 100
    tolerance: float = 1e-6
    inlier_spacings: float = 3.0

    def __post_init__(self) -> None:
        require_positive("keep", self.keep, 1.0)
        require_count("max_iterations", self.max_iterations, 1)
        require_positive("tolerance", self.tolerance, 1.0)
        require_positive("inlier_spacings", self.inlier_spacings)

    def __call__(
        self,
        moving_mm: Float64[np.ndarray, "m 3"],
        fixed_mm: Float64[np.ndarray, "n 3"],
        initial: Float64[np.ndarray, "4 4"] | None = None,
    ) -> RigidResult:
        """Register ``moving_mm`` to ``fixed_mm`` from ``initial`` (a fixed_T_moving), or from where they lie.

        Raises InputError for a cloud that is empty, not finite or degenerate, or an ``initial`` that is not rigid.
        """
        begin_s = time.perf_counter()
        require_cloud(moving_mm, "moving_mm")
        require_cloud(fixed_mm, "fixed_mm")
        start = np.eye(4) if initial is None else frames.require_rigid(initial, "initial")
        if self.align_centroids:
            centre_mm = frames.apply(start, moving_mm.mean(axis=0))
            start = frames.compose(frames.translation(fixed_mm.mean(axis=0) - centre_mm), start)
        target = TreeTarget(fixed_mm)
        found = align(
            moving_mm,
            target,
            start[None],
            keep=self.keep,
            max_iterations=self.max_iterations,
            tolerance=self.tolerance,
        )
        pose = found.fixed_T_moving[0]
        measured = fit(moving_mm, target, pose, keep=self.keep, inlier_spacings=self.inlier_spacings)
        return RigidResult(
            fixed_T_moving=pose,
            rmse_mm=measured.rmse_mm,
            rmse_trimmed_mm=measured.rmse_trimmed_mm,
            inlier_share=measured.inlier_share,
            iterations=int(found.iterations[0]),
            converged=bool(found.converged[0]),
            candidates=(Candidate(pose, float(found.rmse_mm[0]), basin=0, starts=1, stage="fine"),),
            runtime_s=time.perf_counter() - begin_s,
        )
