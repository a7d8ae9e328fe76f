"""Generalised ICP: every point stands for the plane around it, on both sides."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from registration import transforms
from registration.checks import require_count, require_positive
from registration.rigid.comparators.common import single_result
from registration.rigid.icp.correspondence import TreeTarget
from registration.rigid.result import RigidResult
from registration.rigid.rigid_input import rigid_clouds
from registration.rigid.search_cone import SearchCone, known_pose


@dataclass(frozen=True)
class GeneralisedICP:
    """Plane-to-plane ICP from one pose, by small_gicp.

    Parameters
    ----------
    max_distance_mm : float
        Largest distance in mm of pairs that count, which is what the method has in place of trimming: it must be as
        large as the clouds are apart at the start.
    translation_tolerance_mm : float
        It stops once a step moves by less (mm) and turns by less than the next.
    rotation_tolerance_deg : float, optional
        Smallest turn of a step in degrees.
    neighbours : int, optional
        Number of points that a covariance is estimated from, at least 5.
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
    A. Segal, D. Haehnel and S. Thrun, RSS 2009.

    K. Koide, JOSS 9(100), 2024.
    """

    max_distance_mm: float
    translation_tolerance_mm: float
    rotation_tolerance_deg: float = 0.01
    neighbours: int = 20
    max_iterations: int = 100
    keep: float = 0.9
    inlier_spacings: float = 3.0

    def __post_init__(self) -> None:
        for name in (
            "max_distance_mm",
            "translation_tolerance_mm",
            "rotation_tolerance_deg",
            "inlier_spacings",
        ):
            require_positive(name, getattr(self, name))
        # With fewer than five neighbours the library takes the identity for the covariance.
        require_count("neighbours", self.neighbours, 5)
        require_count("max_iterations", self.max_iterations, 1)
        require_positive("keep", self.keep, 1.0)

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
        moving, fixed = rigid_clouds(moving_mm, fixed_mm, self.neighbours)
        known = known_pose(initial, search_cone)
        start = np.eye(4) if known is None else known
        pose, iterations, converged = self._align(moving, fixed, start)
        return single_result(
            moving,
            TreeTarget(fixed),
            pose,
            start=start,
            keep=self.keep,
            inlier_spacings=self.inlier_spacings,
            iterations=iterations,
            converged=converged,
            initial=known,
            search_cone=search_cone,
            begin_s=begin_s,
        )

    def _align(
        self, moving_mm: np.ndarray, fixed_mm: np.ndarray, start: np.ndarray
    ) -> tuple[np.ndarray, int, bool]:
        """The pose it ends in, the steps taken, and whether it settled."""
        import small_gicp

        # The steps turn about the origin, which is far from a vessel as a rule: both clouds are brought there.
        to_moving = transforms.translation(moving_mm.mean(axis=0))
        to_fixed = transforms.translation(fixed_mm.mean(axis=0))
        centred = transforms.compose(transforms.invert_rigid(to_fixed), start, to_moving)
        found = small_gicp.align(
            self._prepared(small_gicp, transforms.apply(transforms.invert_rigid(to_fixed), fixed_mm)),
            self._prepared(small_gicp, transforms.apply(transforms.invert_rigid(to_moving), moving_mm)),
            init_T_target_source=centred,
            registration_type="GICP",
            max_correspondence_distance=self.max_distance_mm,
            num_threads=1,
            max_iterations=self.max_iterations,
            rotation_epsilon=np.deg2rad(self.rotation_tolerance_deg),
            translation_epsilon=self.translation_tolerance_mm,
        )
        # A product of many small rotations drifts from orthonormal by rounding.
        pose = transforms.compose(to_fixed, found.T_target_source, transforms.invert_rigid(to_moving))
        # Without a single pair there is nothing to move by, which the library calls converged.
        return (
            transforms.nearest_rigid(pose),
            int(found.iterations),
            bool(found.converged and found.num_inliers),
        )

    def _prepared(self, small_gicp: Any, points_mm: np.ndarray) -> Any:
        cloud = small_gicp.PointCloud(points_mm)
        small_gicp.estimate_covariances(cloud, num_neighbors=self.neighbours)
        return cloud
