"""Coherent Point Drift as in the textbook, by the compiled package rustcpd, in millimetres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from registration.checks import require_at_least, require_count, require_positive
from registration.deformable.displacement_field import DisplacementField
from registration.errors import InputError
from registration.rigid.icp.correspondence import TreeTarget

# The closest share of the points whose distance both ways gives the first deviation.
KEEP = 0.9


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
    moving_mm: Float64[np.ndarray, "m 3"], fixed_mm: Float64[np.ndarray, "n 3"], settings: PointResiduals
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

    Returns
    -------
    Drifted
        The displacement.
    """
    import rustcpd

    centre_mm = fixed_mm.mean(axis=0)
    fit = rustcpd.register_deformable(
        fixed_mm - centre_mm,
        moving_mm - centre_mm,
        alpha=settings.roughness_per_mm2,
        beta=settings.beta_mm,
        sigma2=_start_mm(moving_mm, fixed_mm, settings) ** 2,
        max_iterations=settings.max_iterations,
        tolerance=settings.tolerance,
        outlier_weight=settings.outlier_weight,
        k=settings.neighbours,
        low_rank=min(settings.rank, len(moving_mm)),
        low_rank_method="pivoted_cholesky",
    )

    def field(points_mm: np.ndarray) -> np.ndarray:
        local_mm = np.ascontiguousarray(points_mm - centre_mm)
        return np.asarray(fit.transform(local_mm)) - local_mm

    return Drifted(field, int(fit.iterations), bool(fit.iterations < settings.max_iterations))


def _start_mm(moving_mm: np.ndarray, fixed_mm: np.ndarray, settings: PointResiduals) -> float:
    """Deviation that the Gaussians start with: of a rigid pose that is right but for the deformation."""
    if settings.sigma0_mm is not None:
        return settings.sigma0_mm
    moving, fixed = TreeTarget(moving_mm), TreeTarget(fixed_mm)
    both_mm = np.sort(np.concatenate([moving.distances_mm(fixed_mm), fixed.distances_mm(moving_mm)]))
    trimmed_mm = float(np.sqrt((both_mm[: max(1, int(KEEP * len(both_mm)))] ** 2).mean()))
    return max(2.0 * trimmed_mm, moving.spacing_mm, settings.expected_deformation_mm)
