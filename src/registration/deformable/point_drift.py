"""Coherent Point Drift as in the textbook, by the compiled package rustcpd, in millimetres."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float64

from registration.checks import require_at_least, require_count, require_positive
from registration.deformable.displacement_field import DisplacementField
from registration.deformable.landmark_constraints import LandmarkConstraints
from registration.errors import InputError
from registration.rigid.icp.correspondence import TreeTarget

# The closest share of the points whose distance both ways gives the first deviation.
KEEP = 0.9
NONRIGID, RIGID, SIMILARITY = MOTIONS = ("nonrigid", "rigid", "similarity")


@dataclass(frozen=True)
class Drifted:
    """What Coherent Point Drift found.

    Parameters
    ----------
    field : callable
        Displacement in mm at any points in mm.
    iterations : int
        Number of iterations.
    converged : bool
        Whether the objective came to rest before they ran out.
    """

    field: DisplacementField
    iterations: int
    converged: bool


@dataclass(frozen=True)
class PointResiduals:
    """Settings of Coherent Point Drift with isotropic Gaussians.

    Parameters
    ----------
    motion : str, optional
        ``nonrigid``, or ``rigid`` or ``similarity`` for a motion of all points together, which the kernel's settings do
        not concern.
    beta_mm : float, optional
        Width in mm of the Gaussian kernel of the displacement.
    roughness_per_mm2 : float, optional
        Weight of the displacement's roughness in 1/mm², lambda of the textbook.
    outlier_weight : float, optional
        Share of fixed points that belong to nothing, 0 to below 1.
    sigma0_mm : float or None, optional
        Standard deviation in mm that the Gaussians start with; None for the largest of twice the trimmed distance both
        ways, the points' spacing and ``expected_deformation_mm``.
    expected_deformation_mm : float, optional
        Displacement in mm that is expected before.
    rank : int, optional
        Rank of the kernel's pivoted Cholesky factor.
    neighbours : int or None, optional
        Number of Gaussians that a fixed point may belong to; None for all.
    tolerance : float, optional
        Change of the objective below which it has come to rest.
    max_iterations : int, optional
        Largest number of iterations.

    Raises
    ------
    InputError
        If a setting is out of range.

    References
    ----------
    A. Myronenko and X. Song, IEEE TPAMI 32(12), 2010.
    """

    motion: str = NONRIGID
    beta_mm: float = 20.0
    roughness_per_mm2: float = 2.0
    outlier_weight: float = 0.1
    sigma0_mm: float | None = None
    expected_deformation_mm: float = 2.0
    rank: int = 300
    neighbours: int | None = 10
    tolerance: float = 1e-5
    max_iterations: int = 100

    def __post_init__(self) -> None:
        if self.motion not in MOTIONS:
            raise InputError(f"motion: expected {', '.join(MOTIONS)}, received {self.motion!r}")
        for name in ("beta_mm", "roughness_per_mm2", "tolerance"):
            require_positive(name, getattr(self, name))
        for name in ("outlier_weight", "expected_deformation_mm"):
            require_at_least(name, getattr(self, name), 0.0)
        if self.outlier_weight >= 1:
            raise InputError(f"outlier_weight: expected a share below 1, received {self.outlier_weight}")
        if self.sigma0_mm is not None:
            require_positive("sigma0_mm", self.sigma0_mm)
        require_count("rank", self.rank, 1)
        require_count("max_iterations", self.max_iterations, 1)
        if self.neighbours is not None:
            require_count("neighbours", self.neighbours, 1)


def drift_points(
    moving_mm: Float64[np.ndarray, "m 3"],
    fixed_mm: Float64[np.ndarray, "n 3"],
    settings: PointResiduals,
    landmarks: LandmarkConstraints | None = None,
) -> Drifted:
    """Drift the moving points onto the fixed ones.

    Both clouds keep their millimetres and get one common centre, so that the kernel's width and the weight of roughness
    mean the same for every cloud.

    Parameters
    ----------
    moving_mm : ndarray, shape (m, 3)
        Moving points in mm.
    fixed_mm : ndarray, shape (n, 3)
        Fixed points in mm, in the same frame.
    settings : PointResiduals
        Settings.
    landmarks : LandmarkConstraints or None, optional
        Pairs of points that are the same material; None where none are known.

    Returns
    -------
    Drifted
        The displacement.

    Raises
    ------
    InputError
        If there are landmarks for a rigid or similarity motion, which takes none.
    """
    if landmarks is not None and settings.motion != NONRIGID:
        raise InputError(
            f"landmarks: expected none for a {settings.motion} motion, received {len(landmarks.moving_mm)}"
        )
    centre_mm = fixed_mm.mean(axis=0)
    moving, fixed = moving_mm - centre_mm, fixed_mm - centre_mm
    common: dict[str, Any] = {
        "sigma2": _start_mm(moving_mm, fixed_mm, settings) ** 2,
        "max_iterations": settings.max_iterations,
        "tolerance": settings.tolerance,
        "outlier_weight": settings.outlier_weight,
        "k": settings.neighbours,
    }
    constraints: dict[str, Any] = {}
    if landmarks is not None:
        # A landmark is a point of both clouds more, that belongs to its own counterpart.
        pairs = range(len(landmarks.moving_mm))
        constraints["constraints"] = [(len(moving) + pair, len(fixed) + pair) for pair in pairs]
        constraints["constraint_error"] = landmarks.deviation_mm**2
        moving, fixed = (
            np.concatenate([cloud, points_mm - centre_mm])
            for cloud, points_mm in ((moving, landmarks.moving_mm), (fixed, landmarks.fixed_mm))
        )
    placed, iterations = (
        _nonrigid(fixed, moving, settings, common | constraints)
        if settings.motion == NONRIGID
        else _together(fixed, moving, settings, common)
    )

    def field(points_mm: np.ndarray) -> np.ndarray:
        local_mm = np.ascontiguousarray(points_mm - centre_mm)
        return placed(local_mm) - local_mm

    return Drifted(field, iterations, iterations < settings.max_iterations)


def _nonrigid(
    fixed_mm: np.ndarray, moving_mm: np.ndarray, settings: PointResiduals, common: dict[str, Any]
) -> tuple[DisplacementField, int]:
    """Places of any points after the drift, each point for itself, and the number of iterations."""
    import rustcpd

    fit = rustcpd.register_deformable(
        fixed_mm,
        moving_mm,
        alpha=settings.roughness_per_mm2,
        beta=settings.beta_mm,
        low_rank=min(settings.rank, len(moving_mm)),
        low_rank_method="pivoted_cholesky",
        **common,
    )
    return lambda local_mm: np.asarray(fit.transform(local_mm)), int(fit.iterations)


def _together(
    fixed_mm: np.ndarray, moving_mm: np.ndarray, settings: PointResiduals, common: dict[str, Any]
) -> tuple[DisplacementField, int]:
    """Places of any points after one motion of all, and the number of iterations."""
    import rustcpd

    fit = rustcpd.register_rigid(fixed_mm, moving_mm, scale=settings.motion == SIMILARITY, **common)
    # It turns rows, p R + t.
    return lambda local_mm: np.asarray(fit.scale * local_mm @ fit.rotation + fit.translation), int(
        fit.iterations
    )


def _start_mm(moving_mm: np.ndarray, fixed_mm: np.ndarray, settings: PointResiduals) -> float:
    """Deviation that the Gaussians start with: of a rigid pose that is right but for the deformation."""
    if settings.sigma0_mm is not None:
        return settings.sigma0_mm
    moving, fixed = TreeTarget(moving_mm), TreeTarget(fixed_mm)
    both_mm = np.sort(np.concatenate([moving.distances_mm(fixed_mm), fixed.distances_mm(moving_mm)]))
    trimmed_mm = float(np.sqrt((both_mm[: max(1, int(KEEP * len(both_mm)))] ** 2).mean()))
    return max(2.0 * trimmed_mm, moving.spacing_mm, settings.expected_deformation_mm)
