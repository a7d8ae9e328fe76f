"""How far the result might lie from the truth: the stiffness of the fit, and a bootstrap over blocks of points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from registration.checks import require_count, require_positive
from registration.errors import InputError
from registration.rigid.icp.estimation import motion_jacobian, motion_transforms, with_offset
from registration.rigid.icp.pairs import closest_pairs
from registration.rigid.icp.robust_kernels import RobustKernel, robust_scale
from registration.rigid.smoothed_target import SmoothedTarget

# A direction with less than this share of the mean stiffness is as good as free.
FREE_SHARE = 1e-6
# How much more the result spreads than a step says, for each square of the roughness: fitted on random anatomies with
# seeds below 1000 and noise of 0.2, 0.5 and 1 mm.
STIFFENING = 12.0
# The spread is itself known only to a factor, whose logarithm has this standard deviation: fitted likewise.
SPREAD_DOUBT = 0.35


@dataclass(frozen=True)
class Uncertainty:
    """Settings of the bootstrap that predicts the error of a pose.

    Parameters
    ----------
    blocks : int, optional
        Number of blocks of points that are drawn with replacement.
    replicates : int, optional
        Number of draws.
    inflation : float, optional
        Factor on the spread; the default was set so that the predicted 90 % intervals hold on random anatomies with
        seeds below 1000.

    Raises
    ------
    InputError
        If there are fewer than 2 blocks or 20 draws, or the factor is not positive.
    """

    blocks: int = 48
    replicates: int = 400
    inflation: float = 1.25

    def __post_init__(self) -> None:
        require_count("blocks", self.blocks, 2)
        require_count("replicates", self.replicates, 20)
        require_positive("inflation", self.inflation)


@dataclass(frozen=True)
class LocalFit:
    """Quadratic that the residuals follow around a pose, block by block.

    Motions are (rotation vector times ``radius_mm``, translation) in mm.

    Parameters
    ----------
    centre_mm : ndarray, shape (3,)
        Centre of rotation in mm in the fixed coordinate frame.
    radius_mm : float
        Radius of the cloud in mm.
    stiffness : ndarray, shape (b, u, u)
        Each block's share of the normal equations in the six unknowns, and a seventh where the walls may be offset.
    pull_mm : ndarray, shape (b, u)
        Each block's share of their right-hand side.
    roughness : float
        Robust scale of the residuals over the reach that normals are estimated from: they are wrong by about this angle
        in rad.
    """

    centre_mm: Float64[np.ndarray, "3"]
    radius_mm: float
    stiffness: Float64[np.ndarray, "b u u"]
    pull_mm: Float64[np.ndarray, "b u"]
    roughness: float

    def motions(self, motion_mm: Float64[np.ndarray, "k 6"]) -> Float64[np.ndarray, "k 4 4"]:
        """Turn small motions into transforms.

        Parameters
        ----------
        motion_mm : ndarray, shape (k, 6)
            Motions in mm.

        Returns
        -------
        ndarray, shape (k, 4, 4)
            Transforms (fixed_T_fixed).
        """
        return motion_transforms(motion_mm, self.centre_mm, self.radius_mm)


def local_fit(
    moving_mm: Float64[np.ndarray, "m 3"],
    target: SmoothedTarget,
    fixed_T_moving: Float64[np.ndarray, "4 4"],
    block: Int64[np.ndarray, " m"],
    kernel: RobustKernel,
    offset: bool = False,
) -> LocalFit:
    """Linearise the point-to-plane residuals at a pose.

    Residuals are to the smoothed surface: those to the closest point are too small, the more so the noisier the
    cloud, for the closest point is one that the noise brought near.

    Parameters
    ----------
    moving_mm : ndarray, shape (m, 3)
        Moving points in mm.
    target : SmoothedTarget
        Fixed cloud without its noise.
    fixed_T_moving : ndarray, shape (4, 4)
        Pose.
    block : ndarray of int, shape (m,)
        Block of each moving point.
    kernel : RobustKernel
        Weights of the residuals.
    offset : bool, optional
        Whether the walls may lie apart by the same distance everywhere.

    Returns
    -------
    LocalFit
        Normal equations of each block.

    Raises
    ------
    InputError
        If the fixed cloud has no normals.
    """
    pairs = closest_pairs(moving_mm, target, fixed_T_moving[None])
    if pairs.normals is None:
        raise InputError("target: expected normals of the fixed surface to linearise along, received none")
    moved_mm, gap_mm = pairs.moved_mm[0], pairs.gap_mm[0]
    if offset:
        gap_mm = gap_mm - np.median(gap_mm)
    centre_mm = moved_mm.mean(axis=0)
    radius_mm = float(np.sqrt(((moved_mm - centre_mm) ** 2).sum(axis=1).mean()))
    scale_mm = robust_scale(gap_mm[None], FREE_SHARE * radius_mm)[0]
    jacobian = motion_jacobian((moved_mm - centre_mm) / radius_mm, pairs.normals[0])
    if offset:
        jacobian = with_offset(jacobian)
    weighted = jacobian * kernel(gap_mm / scale_mm)[:, None]
    count = int(block.max()) + 1
    order = np.argsort(block, kind="stable")
    first = np.searchsorted(block[order], np.arange(count))
    stiffness = np.add.reduceat((weighted[:, :, None] * jacobian[:, None, :])[order], first, axis=0)
    pull_mm = np.add.reduceat((weighted * gap_mm[:, None])[order], first, axis=0)
    return LocalFit(centre_mm, radius_mm, stiffness, pull_mm, float(scale_mm[0] / target.reach_mm))


def bootstrap_motions(
    fit: LocalFit, replicates: int, inflation: float, rng: np.random.Generator
) -> Float64[np.ndarray, "k 6"]:
    """Compute where a pose would have moved had other blocks been seen, blocks drawn with replacement.

    One Gauss-Newton step a replicate. Normals that are wrong make the fit seem stiffer than it is, by the square
    of their error.

    Parameters
    ----------
    fit : LocalFit
        Normal equations of each block.
    replicates : int
        Number of draws.
    inflation : float
        Factor that makes up for what a step leaves out: the fixed cloud's own noise, and that pairs follow the pose.
    rng : numpy.random.Generator
        Source of the draws.

    Returns
    -------
    ndarray, shape (k, 6)
        Motions in mm.

    References
    ----------
    H. R. Künsch, Ann. Stat. 17(3), 1989 (blocks).

    W. R. Schucany and S. Wang, J. R. Stat. Soc. B 53(3), 1991 (steps in place of solutions).
    """
    count = len(fit.stiffness)
    drawn = rng.multinomial(count, np.full(count, 1 / count), size=replicates).astype(np.float64)
    stiffness = np.tensordot(drawn, fit.stiffness, axes=1)
    pull_mm = drawn @ (fit.pull_mm - fit.pull_mm.mean(axis=0))
    unknowns = stiffness.shape[1]
    mean = np.trace(stiffness, axis1=1, axis2=2)[:, None, None] / unknowns
    damped = stiffness + FREE_SHARE * mean * np.eye(unknowns)
    try:
        solved = np.linalg.solve(damped, pull_mm[..., None])[:, :6]
    except np.linalg.LinAlgError:
        # A draw without a point that weighs: a handful of points, or all of them outliers.
        solved = (np.linalg.pinv(damped) @ pull_mm[..., None])[:, :6]
    doubt = np.exp(SPREAD_DOUBT * rng.standard_normal((replicates, 1)))
    return inflation * (1 + STIFFENING * fit.roughness**2) * doubt * solved[..., 0]
