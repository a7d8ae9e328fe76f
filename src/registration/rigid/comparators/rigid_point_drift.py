"""Rigid Coherent Point Drift: the moving points are centres of Gaussians that the fixed ones are drawn from."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from registration import transforms
from registration.checks import require_at_least, require_count, require_positive
from registration.errors import InputError
from registration.rigid.comparators.common import single_result
from registration.rigid.icp.correspondence import TreeTarget
from registration.rigid.result import RigidResult
from registration.rigid.rigid_input import rigid_clouds
from registration.rigid.search_cone import SearchCone, known_pose

# The rotation needs as many points.
MIN_POINTS = 4


@dataclass(frozen=True)
class RigidPointDrift:
    """Coherent Point Drift of a rigid motion from one pose, by rustcpd.

    Parameters
    ----------
    outlier_weight : float, optional
        Share of fixed points that belong to nothing, 0 to below 1.
    neighbours : int or None, optional
        Number of Gaussians that a fixed point may belong to; None for all, whose memory grows as the product of both
        clouds' points.
    tolerance : float, optional
        Change of the objective below which it has come to rest.
    max_iterations : int, optional
        Largest number of iterations.
    keep : float, optional
        Share of closest points in the trimmed residual.
    inlier_spacings : float, optional
        An inlier lies within so many distances between neighbouring points.

    Raises
    ------
    InputError
        If a setting is outside its range.

    References
    ----------
    A. Myronenko and X. Song, IEEE TPAMI 32(12), 2010.
    """

    outlier_weight: float = 0.1
    neighbours: int | None = None
    tolerance: float = 1e-5
    max_iterations: int = 200
    keep: float = 0.9
    inlier_spacings: float = 3.0

    def __post_init__(self) -> None:
        require_at_least("outlier_weight", self.outlier_weight, 0.0)
        if self.outlier_weight >= 1:
            raise InputError(f"outlier_weight: expected a share below 1, received {self.outlier_weight}")
        if self.neighbours is not None:
            require_count("neighbours", self.neighbours, 1)
        require_positive("tolerance", self.tolerance)
        require_count("max_iterations", self.max_iterations, 1)
        require_positive("keep", self.keep, 1.0)
        require_positive("inlier_spacings", self.inlier_spacings)

    def __call__(
        self,
        moving_mm: ArrayLike,
        fixed_mm: ArrayLike,
        initial: ArrayLike | None = None,
        *,
        search_cone: SearchCone | None = None,
        moving_centerline_mm: ArrayLike | None = None,
        fixed_centerline_mm: ArrayLike | None = None,
        moving_frame: ArrayLike | None = None,
    ) -> RigidResult:
        """Register a moving cloud to a fixed one from one pose.

        Parameters
        ----------
        moving_mm : array_like, shape (m, 3)
            Moving points in mm.
        fixed_mm : array_like, shape (n, 3)
            Fixed points in mm.
        initial : array_like, shape (4, 4), or None, optional
            Known pose (fixed_T_moving) to start from; None starts from where the clouds lie.
        search_cone : SearchCone or None, optional
            Bound around ``initial``; None stands for 45 degrees and 20 mm. A result outside it has failed: the
            pose is then the one on that bound.
        moving_centerline_mm, fixed_centerline_mm, moving_frame : None, optional
            Not used.

        Returns
        -------
        RigidResult
            Pose and residuals; the method does not assess them.

        Raises
        ------
        InputError
            If a cloud is empty, of another shape, not finite, degenerate or in metres, ``initial`` is not rigid,
            or there is a cone without it.
        """
        del moving_centerline_mm, fixed_centerline_mm, moving_frame
        begin_s = time.perf_counter()
        moving, fixed = rigid_clouds(moving_mm, fixed_mm, MIN_POINTS)
        known = known_pose(initial, search_cone)
        start = np.eye(4) if known is None else known
        pose, iterations = self._drift(transforms.apply(start, moving), fixed)
        return single_result(
            moving,
            TreeTarget(fixed),
            transforms.compose(pose, start),
            start=start,
            keep=self.keep,
            inlier_spacings=self.inlier_spacings,
            iterations=iterations,
            converged=iterations < self.max_iterations,
            initial=known,
            search_cone=search_cone,
            begin_s=begin_s,
        )

    def _drift(self, moving_mm: np.ndarray, fixed_mm: np.ndarray) -> tuple[np.ndarray, int]:
        """The motion from the start, and the number of iterations."""
        import rustcpd

        # Far from the origin its sums lose their digits.
        centre_mm = fixed_mm.mean(axis=0)
        found = rustcpd.register_rigid(
            fixed_mm - centre_mm,
            moving_mm - centre_mm,
            scale=False,
            max_iterations=self.max_iterations,
            tolerance=self.tolerance,
            outlier_weight=self.outlier_weight,
            k=self.neighbours,
        )
        local = np.eye(4)
        # It turns rows, p R + t.
        local[:3, :3], local[:3, 3] = found.rotation.T, found.translation
        centred = transforms.translation(centre_mm)
        pose = transforms.compose(centred, transforms.nearest_rigid(local), transforms.invert_rigid(centred))
        return pose, int(found.iterations)
