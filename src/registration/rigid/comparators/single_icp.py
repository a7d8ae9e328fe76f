"""Iterative closest points from one pose, point-to-point or point-to-plane, as it is commonly run."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from registration import transforms
from registration.checks import require_count, require_positive
from registration.errors import InputError
from registration.rigid.comparators.common import single_result
from registration.rigid.icp.correspondence import TreeTarget
from registration.rigid.icp.loop import align
from registration.rigid.result import RigidResult
from registration.rigid.rigid_input import rigid_clouds
from registration.rigid.search_cone import SearchCone, known_pose


@dataclass(frozen=True)
class SingleStartICP:
    """ICP from one pose, as it is commonly run.

    Parameters
    ----------
    align_centroids : bool, optional
        Whether the centroids are brought together first.
    refine_by : str, optional
        ``point`` (Besl and McKay) or ``plane`` (Chen and Medioni).
    neighbours : int, optional
        Number of fixed points that a normal is estimated from.
    keep : float, optional
        Share of closest pairs that counts in each step.
    max_iterations : int, optional
        Largest number of iterations.
    tolerance : float, optional
        Relative change of the residual below which it has settled.
    inlier_spacings : float, optional
        An inlier lies within so many distances between neighbouring points.

    Raises
    ------
    InputError
        If a setting is outside its range.

    References
    ----------
    P. J. Besl and N. D. McKay, IEEE PAMI 14(2), 1992.

    Y. Chen and G. Medioni, Image Vision Comput. 10(3), 1992.
    """

    align_centroids: bool = False
    refine_by: str = "point"
    neighbours: int = 20
    keep: float = 1.0
    max_iterations: int = 100
    tolerance: float = 1e-6
    inlier_spacings: float = 3.0

    def __post_init__(self) -> None:
        if self.refine_by not in ("plane", "point"):
            raise InputError(f"refine_by: expected plane or point, received {self.refine_by!r}")
        require_count("neighbours", self.neighbours, 3)
        require_positive("keep", self.keep, 1.0)
        require_count("max_iterations", self.max_iterations, 1)
        require_positive("tolerance", self.tolerance, 1.0)
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
        moving, fixed = rigid_clouds(moving_mm, fixed_mm)
        known = known_pose(initial, search_cone)
        start = np.eye(4) if known is None else known
        if self.align_centroids:
            centre_mm = transforms.apply(start, moving.mean(axis=0))
            start = transforms.compose(transforms.translation(fixed.mean(axis=0) - centre_mm), start)
        target = TreeTarget(fixed, self.neighbours if self.refine_by == "plane" else 0)
        found = align(
            moving,
            target,
            start[None],
            keep=self.keep,
            max_iterations=self.max_iterations,
            tolerance=self.tolerance,
        )
        return single_result(
            moving,
            target,
            found.fixed_T_moving[0],
            start=start,
            keep=self.keep,
            inlier_spacings=self.inlier_spacings,
            iterations=int(found.iterations[0]),
            converged=bool(found.converged[0]),
            initial=known,
            search_cone=search_cone,
            begin_s=begin_s,
        )
