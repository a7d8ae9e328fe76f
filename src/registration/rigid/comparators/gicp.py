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
    """Plane-to-plane ICP from one pose: Segal, Haehnel and Thrun, RSS 2009, by small_gicp (Koide, JOSS 9(100), 2024).

    Pairs farther apart than ``max_distance_mm`` do not count, which is what the method has in place of trimming: it
    must be as large as the clouds are apart at the start. Covariances come from ``neighbours`` points. It stops once a
    step turns by less than ``rotation_tolerance_deg`` and moves by less than ``translation_tolerance_mm``, or after
    ``max_iterations``. ``keep`` is the share of closest points in the trimmed residual.
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
        """Register ``moving_mm`` to ``fixed_mm`` from ``initial`` (a fixed_T_moving), or from where they lie.

        Clouds are arrays or lists of shape (m, 3) and (n, 3), poses (4, 4). A result outside the bound around
        ``initial`` (``search_cone``, or 45 degrees and 20 mm) has failed: the pose is then the one on that bound.
        Centerlines and frames are not used. Raises InputError for a cloud that is empty, of another shape, not finite,
        degenerate or in metres, an ``initial`` that is not rigid, or a cone without one.
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
