"""Coherent Point Drift after a rigid registration: tight along the wall's normals, or as in the textbook."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float64, Int64
from numpy.typing import ArrayLike
from threadpoolctl import threadpool_limits

from registration.deformable.displacement_field import DisplacementField, Plausibility, plausibility
from registration.deformable.landmark_constraints import LandmarkConstraints
from registration.deformable.point_drift import Drifted, PointResiduals, drift_points
from registration.deformable.result import (
    DEFORMED,
    FAILED,
    RIGID_STANDS,
    DeformableResult,
    PredictedError,
)
from registration.deformable.wall_displacement import WallDisplacement, WallResiduals, displace_wall
from registration.errors import InputError
from registration.geometry.shapes import require_cloud, require_millimetres
from registration.metrics.surface_distance import rms
from registration.rigid.icp.correspondence import TreeTarget
from registration.rigid.residual_model.model import MIN_SIZE_SPACINGS
from registration.rigid.smoothed_target import SmoothedTarget, outward_targets

PLANE, POINT = "plane", "point"
MIN_POINTS = 50
# Normals are taken from so many neighbours, and the wall is smoothed over twice as many.
NEIGHBOURS = 12
# Clouds that lie apart by more than this share of the moving cloud's radius are not yet registered.
APART_SHARE = 0.25
# Of the fixed points so many must lie near the wall to be what it is displaced to.
MIN_SHARE = 0.3


@dataclass(frozen=True)
class CoherentPointDrift:
    """Non-rigid registration of a moving cloud, that of the model, to fixed points that a sweep has seen.

    ``residual="plane"`` takes distances along the moving wall's normals, and a Gaussian process for the displacement
    whose parameters the restricted likelihood weighs. ``residual="point"`` is Coherent Point Drift by Myronenko and
    Song: every moving point is the centre of an isotropic Gaussian. Parts of the moving cloud that no fixed point
    belongs to go with the rest: beyond what was seen the displacement of ``plane`` fades into the small rigid motion
    that the seen part asks for, and that of ``point`` into none.

    Parameters
    ----------
    residual : str, optional
        ``plane`` or ``point``.
    plane : WallResiduals, optional
        Settings of ``residual="plane"``.
    point : PointResiduals, optional
        Settings of ``residual="point"``.

    References
    ----------
    A. Myronenko and X. Song, IEEE TPAMI 32(12), 2010. N. Cressie, Statistics for Spatial Data, Wiley, 1993.

    Raises
    ------
    InputError
        If there is no such residual.
    """

    residual: str = PLANE
    plane: WallResiduals = field(default_factory=WallResiduals)
    point: PointResiduals = field(default_factory=PointResiduals)

    def __post_init__(self) -> None:
        if self.residual not in (PLANE, POINT):
            raise InputError(f"residual: expected plane or point, received {self.residual!r}")

    def __call__(
        self,
        moving_mm: ArrayLike,
        fixed_mm: ArrayLike,
        *,
        fixed_frame: Int64[np.ndarray, " n"] | None = None,
        landmarks: LandmarkConstraints | None = None,
        seed: int = 0,
    ) -> DeformableResult:
        """Displace the moving cloud onto the fixed one.

        Parameters
        ----------
        moving_mm : ndarray, shape (m, 3)
            Moving points in mm, in the frame of the fixed ones: registered rigidly before.
        fixed_mm : ndarray, shape (n, 3)
            Fixed points in mm.
        fixed_frame : ndarray of int, shape (n,), or None, optional
            Frame of the sweep that each fixed point was seen in: frames have errors of their own.
        landmarks : LandmarkConstraints or None, optional
            Pairs of points that are the same material, as constraints; None where none are known.
        seed : int, optional
            Seed of the draws that predict the error.

        Returns
        -------
        DeformableResult
            Displacement, verdict and predicted error.

        Raises
        ------
        InputError
            If a cloud is no cloud in mm, has fewer than 50 points, or they are not registered rigidly yet; or there are
            landmarks for a rigid or similarity motion.
        """
        begun = time.perf_counter()
        moving, fixed = (
            require_millimetres(require_cloud(points_mm, name, MIN_POINTS), name)
            for points_mm, name in ((moving_mm, "moving_mm"), (fixed_mm, "fixed_mm"))
        )
        if fixed_frame is not None and len(fixed_frame) != len(fixed):
            raise InputError(f"fixed_frame: expected {len(fixed)} frames, received {len(fixed_frame)}")
        _require_registered(moving, fixed)
        if self.residual == POINT:
            return _drifted(moving, fixed, drift_points(moving, fixed, self.point, landmarks), begun)
        _, wall = outward_targets(moving, NEIGHBOURS, 2 * NEIGHBOURS)
        # Its matrices are small: threads of the linear algebra cost several times what they save.
        with threadpool_limits(1, user_api="blas"):
            found = displace_wall(wall, fixed, self.plane, fixed_frame, landmarks)
            if found is None or found.residuals.share < MIN_SHARE:
                raise InputError(
                    "fixed_mm: expected points next to the moving wall, received too few near it; "
                    "register rigidly first"
                )
            return _judged(moving, fixed, wall, found, self.plane, begun, seed)


def _judged(
    moving: np.ndarray,
    fixed: np.ndarray,
    wall: SmoothedTarget,
    found: WallDisplacement,
    settings: WallResiduals,
    begun: float,
    seed: int,
) -> DeformableResult:
    """The displacement where the data show one; where they do not, none."""
    size_mm = found.posterior.bent_mm()
    taken = found.fits.gain >= settings.min_gain and size_mm >= MIN_SIZE_SPACINGS * wall.spacing_mm
    posterior = found.posterior if taken else found.rigid
    displacement: DisplacementField = posterior.mean_mm if taken else np.zeros_like
    shown = plausibility(displacement, moving)
    verdict, reason = DEFORMED, f"the clouds show a deformation of {size_mm:.2g} mm"
    if not taken:
        verdict, reason = RIGID_STANDS, "the clouds show no deformation, and none is applied"
    moved_mm = moving + displacement(moving)
    return DeformableResult(
        moved_mm,
        displacement,
        *_unless_folded(shown, verdict, reason),
        shown,
        rms(TreeTarget(moved_mm).distances_mm(fixed)),
        found.fits.gain,
        size_mm,
        found.iterations,
        found.settled,
        time.perf_counter() - begun,
        PredictedError(posterior, taken, settings.inflation, settings.size_doubt, seed),
    )


def _drifted(moving: np.ndarray, fixed: np.ndarray, found: Drifted, begun: float) -> DeformableResult:
    displaced_mm = found.field(moving)
    shown = plausibility(found.field, moving)
    reason = "Coherent Point Drift does not tell whether the clouds show a deformation"
    return DeformableResult(
        moving + displaced_mm,
        found.field,
        *_unless_folded(shown, DEFORMED, reason),
        shown,
        rms(TreeTarget(moving + displaced_mm).distances_mm(fixed)),
        float("nan"),
        rms(np.linalg.norm(displaced_mm, axis=1)),
        found.iterations,
        found.converged,
        time.perf_counter() - begun,
    )


def _unless_folded(shown: Plausibility, verdict: str, reason: str) -> tuple[str, str]:
    if shown.folds:
        return FAILED, f"the field folds (smallest Jacobian determinant {shown.jacobian_min:.2g})"
    return verdict, reason


def _require_registered(moving: Float64[np.ndarray, "m 3"], fixed: Float64[np.ndarray, "n 3"]) -> None:
    """Refuse clouds that lie so far apart that closest points mean nothing."""
    away_mm = float(np.median(TreeTarget(moving).distances_mm(fixed)))
    radius_mm = float(np.sqrt(moving.var(axis=0).sum()))
    if away_mm > APART_SHARE * radius_mm:
        raise InputError(
            f"fixed_mm: expected points near the moving ones, received half of them more than {away_mm:.3g} mm away "
            f"(radius of the moving cloud {radius_mm:.3g} mm); register rigidly first"
        )
