"""Global registration by local features: fast point feature histograms, matched by RANSAC or all at once."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from registration import transforms
from registration.checks import require_count, require_positive
from registration.geometry.open3d_bridge import quiet_open3d
from registration.rigid.comparators.common import refined
from registration.rigid.comparators.fpfh_features import FpfhFeatures
from registration.rigid.comparators.single_icp import SingleStartICP
from registration.rigid.result import RigidResult
from registration.rigid.rigid_input import rigid_clouds
from registration.rigid.search_cone import SearchCone, known_pose


@dataclass(frozen=True)
class FpfhRansac:
    """Poses proposed by random triples of points with matching features; the one with most inliers wins (Open3D).

    Parameters
    ----------
    features : FpfhFeatures
        Features of both clouds.
    max_distance_mm : float
        Largest distance of an inlier in mm.
    edge_similarity : float, optional
        A triple is passed over if an edge is shorter than this share of its counterpart.
    max_iterations : int, optional
        Largest number of triples.
    confidence : float, optional
        The search stops once a better triple is less likely than 1 minus this.
    refine : SingleStartICP, optional
        Method that takes the pose to its optimum.
    seed : int, optional
        Seed of the draws.

    Raises
    ------
    InputError
        If a setting is outside its range.

    References
    ----------
    M. A. Fischler and R. C. Bolles, Commun. ACM 24(6), 1981.
    """

    features: FpfhFeatures
    max_distance_mm: float
    edge_similarity: float = 0.9
    max_iterations: int = 100_000
    confidence: float = 0.999
    refine: SingleStartICP = field(default_factory=lambda: SingleStartICP(refine_by="plane", keep=0.9))
    seed: int = 0

    def __post_init__(self) -> None:
        require_positive("max_distance_mm", self.max_distance_mm)
        require_positive("edge_similarity", self.edge_similarity, 1.0)
        require_count("max_iterations", self.max_iterations, 1)
        require_positive("confidence", self.confidence, 1.0)
        require_count("seed", self.seed, 0)

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
        """Register a moving cloud to a fixed one from anywhere.

        Parameters
        ----------
        moving_mm : array_like, shape (m, 3)
            Moving points in mm.
        fixed_mm : array_like, shape (n, 3)
            Fixed points in mm.
        initial : array_like, shape (4, 4), or None, optional
            Known pose (fixed_T_moving), which is refined too; the better pose wins. None searches only.
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
            there is a cone without it, or no features match and there is no ``initial``.
        """
        del moving_centerline_mm, fixed_centerline_mm, moving_frame
        return _registered(self, moving_mm, fixed_mm, initial, search_cone)

    def search(self, moving: tuple[Any, Any], fixed: tuple[Any, Any]) -> Any:
        """Search by random triples.

        Parameters
        ----------
        moving : tuple
            Thinned moving cloud and its features, as Open3D has them.
        fixed : tuple
            Thinned fixed cloud and its features.

        Returns
        -------
        open3d.pipelines.registration.RegistrationResult
            Open3D's result.
        """
        with quiet_open3d() as open3d:
            registration = open3d.pipelines.registration
            open3d.utility.random.seed(self.seed)
            return registration.registration_ransac_based_on_feature_matching(
                moving[0],
                fixed[0],
                moving[1],
                fixed[1],
                True,
                self.max_distance_mm,
                registration.TransformationEstimationPointToPoint(False),
                3,
                [
                    registration.CorrespondenceCheckerBasedOnEdgeLength(self.edge_similarity),
                    registration.CorrespondenceCheckerBasedOnDistance(self.max_distance_mm),
                ],
                registration.RANSACConvergenceCriteria(self.max_iterations, self.confidence),
            )


@dataclass(frozen=True)
class FpfhFastGlobal:
    """All matches of features at once, wrong ones switched off by a robust kernel that tightens (Open3D).

    Parameters
    ----------
    features : FpfhFeatures
        Features of both clouds.
    max_distance_mm : float
        Largest distance in mm of pairs that count in the end.
    edge_similarity : float, optional
        A triple of matches is left out if an edge is shorter than this share of its counterpart.
    max_triples : int, optional
        Largest number of triples that are kept.
    iterations : int, optional
        Number of iterations.
    refine : SingleStartICP, optional
        Method that takes the pose to its optimum.
    seed : int, optional
        Seed of the draws.

    Raises
    ------
    InputError
        If a setting is outside its range.

    References
    ----------
    Q.-Y. Zhou, J. Park and V. Koltun, "Fast global registration", ECCV 2016.
    """

    features: FpfhFeatures
    max_distance_mm: float
    edge_similarity: float = 0.95
    max_triples: int = 1000
    iterations: int = 64
    refine: SingleStartICP = field(default_factory=lambda: SingleStartICP(refine_by="plane", keep=0.9))
    seed: int = 0

    def __post_init__(self) -> None:
        require_positive("max_distance_mm", self.max_distance_mm)
        require_positive("edge_similarity", self.edge_similarity, 1.0)
        require_count("max_triples", self.max_triples, 1)
        require_count("iterations", self.iterations, 1)
        require_count("seed", self.seed, 0)

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
        """Register a moving cloud to a fixed one from anywhere.

        Parameters
        ----------
        moving_mm : array_like, shape (m, 3)
            Moving points in mm.
        fixed_mm : array_like, shape (n, 3)
            Fixed points in mm.
        initial : array_like, shape (4, 4), or None, optional
            Known pose (fixed_T_moving), which is refined too; the better pose wins. None searches only.
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
            there is a cone without it, or no features match and there is no ``initial``.
        """
        del moving_centerline_mm, fixed_centerline_mm, moving_frame
        return _registered(self, moving_mm, fixed_mm, initial, search_cone)

    def search(self, moving: tuple[Any, Any], fixed: tuple[Any, Any]) -> Any:
        """Search by all matches at once.

        Parameters
        ----------
        moving : tuple
            Thinned moving cloud and its features, as Open3D has them.
        fixed : tuple
            Thinned fixed cloud and its features.

        Returns
        -------
        open3d.pipelines.registration.RegistrationResult
            Open3D's result.
        """
        with quiet_open3d() as open3d:
            registration = open3d.pipelines.registration
            open3d.utility.random.seed(self.seed)
            # Lengths are in mm and stay so: Open3D would scale the distance by the clouds' size otherwise.
            option = registration.FastGlobalRegistrationOption(
                use_absolute_scale=True,
                decrease_mu=True,
                maximum_correspondence_distance=self.max_distance_mm,
                iteration_number=self.iterations,
                tuple_scale=self.edge_similarity,
                maximum_tuple_count=self.max_triples,
            )
            return registration.registration_fgr_based_on_feature_matching(
                moving[0], fixed[0], moving[1], fixed[1], option
            )


def _registered(
    method: FpfhRansac | FpfhFastGlobal,
    moving_mm: ArrayLike,
    fixed_mm: ArrayLike,
    initial: ArrayLike | None,
    search_cone: SearchCone | None,
) -> RigidResult:
    """Features of both clouds about their centres, the method's search, and the refinement of what it found."""
    begin_s = time.perf_counter()
    moving, fixed = rigid_clouds(moving_mm, fixed_mm)
    known = known_pose(initial, search_cone)
    moving_centre_mm, fixed_centre_mm = moving.mean(axis=0), fixed.mean(axis=0)
    found = method.search(
        method.features(moving - moving_centre_mm, "moving_mm"),
        method.features(fixed - fixed_centre_mm, "fixed_mm"),
    )
    pose = None
    # Without a single inlier Open3D returns the identity.
    if found.fitness > 0:
        pose = transforms.compose(
            transforms.translation(fixed_centre_mm),
            transforms.nearest_rigid(np.array(found.transformation)),
            transforms.translation(-moving_centre_mm),
        )
    return refined(pose, method.refine, moving, fixed, known, search_cone, begin_s)
