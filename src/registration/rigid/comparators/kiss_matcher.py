"""KISS-Matcher: fast features, matches pruned by graphs, and a robust solver; an optional part."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from registration import transforms
from registration.checks import require_count, require_positive
from registration.errors import InputError
from registration.rigid.comparators.common import refined
from registration.rigid.comparators.single_icp import SingleStartICP
from registration.rigid.result import RigidResult
from registration.rigid.rigid_input import rigid_clouds
from registration.rigid.search_cone import SearchCone, known_pose


@dataclass(frozen=True)
class KissMatcher:
    """KISS-Matcher: fast features, matches pruned by graphs, and a robust solver, by its own package.

    The package kiss-matcher is imported at the call.

    Parameters
    ----------
    voxel_mm : float
        Clouds are thinned to one point in each cube of this side in mm.
    normal_voxels : float, optional
        Reach of a normal in voxels.
    feature_voxels : float, optional
        Reach of a feature in voxels.
    max_matches : int, optional
        Largest number of matches that go to the solver.
    refine : SingleStartICP, optional
        Method that takes the pose to its optimum.

    Raises
    ------
    InputError
        If a setting is outside its range.

    References
    ----------
    H. Lim et al., "KISS-Matcher: fast and robust point cloud registration revisited", ICRA 2025.
    """

    voxel_mm: float
    normal_voxels: float = 3.0
    feature_voxels: float = 5.0
    max_matches: int = 5000
    refine: SingleStartICP = field(default_factory=lambda: SingleStartICP(refine_by="plane", keep=0.9))

    def __post_init__(self) -> None:
        require_positive("voxel_mm", self.voxel_mm)
        require_positive("normal_voxels", self.normal_voxels)
        require_positive("feature_voxels", self.feature_voxels)
        require_count("max_matches", self.max_matches, 3)
        if self.feature_voxels <= self.normal_voxels:
            raise InputError(
                f"feature_voxels: expected more than normal_voxels ({self.normal_voxels:g}), "
                f"received {self.feature_voxels:g}"
            )

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
            there is a cone without it, nothing matches and there is no ``initial``, or the package is not installed.
        """
        del moving_centerline_mm, fixed_centerline_mm, moving_frame
        begin_s = time.perf_counter()
        moving, fixed = rigid_clouds(moving_mm, fixed_mm)
        known = known_pose(initial, search_cone)
        pose = self._search(moving, fixed)
        return refined(pose, self.refine, moving, fixed, known, search_cone, begin_s)

    def _search(self, moving_mm: np.ndarray, fixed_mm: np.ndarray) -> np.ndarray | None:
        """The pose found, or none."""
        package = _package()
        config = package.KISSMatcherConfig(
            voxel_size=self.voxel_mm,
            num_max_corr=self.max_matches,
            normal_r_gain=self.normal_voxels,
            fpfh_r_gain=self.feature_voxels,
            # Its bounds on noise are clamped to what suits maps in metres otherwise.
            enable_noise_bound_clamping=False,
        )
        # Single precision inside: coordinates are taken from the clouds' centres, so that they keep their digits.
        moving_centre_mm, fixed_centre_mm = moving_mm.mean(axis=0), fixed_mm.mean(axis=0)
        found = package.KISSMatcher(config).estimate(
            (moving_mm - moving_centre_mm).astype(np.float32), (fixed_mm - fixed_centre_mm).astype(np.float32)
        )
        if not found.valid:
            return None
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = found.rotation, np.ravel(found.translation)
        return transforms.compose(
            transforms.translation(fixed_centre_mm),
            transforms.nearest_rigid(pose),
            transforms.translation(-moving_centre_mm),
        )


def _package() -> Any:
    try:
        import kiss_matcher  # type: ignore[import-not-found, import-untyped, unused-ignore]
    except ImportError as missing:
        raise InputError(
            "rigid: expected the package kiss-matcher to be installed, received an environment without it; "
            "install it with: pip install kiss-matcher"
        ) from missing
    return kiss_matcher
