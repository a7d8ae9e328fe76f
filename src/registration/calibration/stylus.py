"""The tip of a tracked stylus, from poses recorded while it turns about its resting tip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.brief import brief_repr
from registration.checks import require_count, require_positive
from registration.errors import InputError


@dataclass(frozen=True)
class PivotResult:
    """Tip of a stylus.

    Parameters
    ----------
    tip_mm : ndarray, shape (3,)
        Tip in the stylus marker's frame in mm.
    pivot_mm : ndarray, shape (3,)
        Point where it rested, in the reference frame in mm.
    residuals_mm : ndarray, shape (n,)
        Distance in mm by which each pose puts the tip off the pivot.
    outliers : ndarray of bool, shape (n,)
        Poses that were left out.
    weakest_mm : float
        Standard error of the tip in mm along the direction that the rotations determined worst.
    """

    tip_mm: Float64[np.ndarray, "3"]
    pivot_mm: Float64[np.ndarray, "3"]
    residuals_mm: Float64[np.ndarray, " n"]
    outliers: Bool[np.ndarray, " n"]
    weakest_mm: float

    __repr__ = brief_repr

    @property
    def rmse_mm(self) -> float:
        """Root mean square of the residuals in mm of the poses that were used."""
        return float(np.sqrt(np.mean(self.residuals_mm[~self.outliers] ** 2)))


@dataclass(frozen=True)
class PivotCalibration:
    """Least-squares pivot calibration with rejection of outliers.

    It solves ``R_i @ tip - pivot = -t_i`` over all poses: the algebraic two-step of Yaniv in one step. Poses
    whose residual is too large are left out until none is.

    Parameters
    ----------
    outlier_sigma : float, optional
        Factor on the root mean square above which a residual is an outlier.
    min_rotation_deg : float, optional
        Smallest range of the rotation about two axes in degrees.
    min_poses : int, optional
        Smallest number of poses, at least 3.

    Raises
    ------
    InputError
        If a value is out of range.

    References
    ----------
    Z. Yaniv, "Which pivot calibration?", SPIE Medical Imaging 9415, 2015.
    """

    outlier_sigma: float = 3.0
    min_rotation_deg: float = 15.0
    min_poses: int = 10

    def __post_init__(self) -> None:
        require_positive("outlier_sigma", self.outlier_sigma)
        require_positive("min_rotation_deg", self.min_rotation_deg, 180)
        require_count("min_poses", self.min_poses, 3)

    def __call__(self, reference_T_stylus: Float64[np.ndarray, "n 4 4"]) -> PivotResult:
        """Find the tip.

        Parameters
        ----------
        reference_T_stylus : ndarray, shape (n, 4, 4)
            Poses of the stylus marker in the reference frame.

        Returns
        -------
        PivotResult
            The tip, the pivot and their residuals.

        Raises
        ------
        InputError
            If there are too few poses (that agree), or rotations that leave the tip undetermined.
        """
        if len(reference_T_stylus) < self.min_poses:
            raise InputError(
                f"reference_T_stylus: expected at least {self.min_poses} poses, received {len(reference_T_stylus)}"
            )
        transforms.require_rigid(reference_T_stylus, "reference_T_stylus")
        self._require_turning(reference_T_stylus)
        kept = np.ones(len(reference_T_stylus), dtype=bool)
        while True:
            tip_mm, pivot_mm, weakest = _solve(reference_T_stylus[kept])
            tips_mm = reference_T_stylus[:, :3, :3] @ tip_mm + reference_T_stylus[:, :3, 3]
            residuals_mm = np.linalg.norm(tips_mm - pivot_mm, axis=1)
            rms_mm = float(np.sqrt(np.mean(residuals_mm[kept] ** 2)))
            still = kept & (residuals_mm <= max(self.outlier_sigma * rms_mm, 1e-9))
            if (still == kept).all():
                return PivotResult(tip_mm, pivot_mm, residuals_mm, ~kept, weakest * rms_mm)
            if still.sum() < self.min_poses:
                raise InputError(
                    f"reference_T_stylus: expected at least {self.min_poses} poses that agree, received {still.sum()}"
                )
            kept = still

    def _require_turning(self, reference_T_stylus: Float64[np.ndarray, "n 4 4"]) -> None:
        """Refuse a stylus that stood still or turned about one axis only: its tip may be anywhere along that."""
        from_mean = transforms.invert_rigid(transforms.mean_rigid(reference_T_stylus)) @ reference_T_stylus
        turns_deg = np.rad2deg(Rotation.from_matrix(from_mean[:, :3, :3]).as_rotvec())
        axes = np.linalg.svd(turns_deg - turns_deg.mean(axis=0), full_matrices=False)[2]
        spans_deg = np.ptp(turns_deg @ axes.T, axis=0)
        if spans_deg[1] < self.min_rotation_deg:
            raise InputError(
                f"reference_T_stylus: expected turning over at least {self.min_rotation_deg:g} degrees about two "
                f"axes, received {spans_deg[0]:.1f} and {spans_deg[1]:.1f}"
            )


def _solve(reference_T_stylus: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Tip, pivot, and the factor from residual to standard error of the tip in its weakest direction."""
    rotations = reference_T_stylus[:, :3, :3]
    negative = np.broadcast_to(-np.eye(3), rotations.shape)
    equations = np.concatenate([rotations, negative], axis=2).reshape(-1, 6)
    solution = np.linalg.lstsq(equations, -reference_T_stylus[:, :3, 3].reshape(-1), rcond=None)[0]
    covariance = np.linalg.inv(equations.T @ equations)[:3, :3]
    return solution[:3], solution[3:], float(np.sqrt(np.linalg.eigvalsh(covariance)[-1] / 3))
