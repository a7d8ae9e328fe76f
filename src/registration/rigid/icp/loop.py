"""Iterative closest points, many starts in one vectorised step, put together from replaceable parts.

Besl and McKay, IEEE PAMI 14(2), 1992 (the loop). Parts: ``correspondence``, ``rejection``, ``estimation``,
``robust_kernels``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64

from registration.rigid.icp.correspondence import Target
from registration.rigid.icp.estimation import Estimation, PointToPlane, PointToPoint
from registration.rigid.icp.pairs import Pairs, closest_pairs
from registration.rigid.icp.rejection import Rejection, trimming_weights
from registration.rigid.icp.robust_kernels import RobustKernel, robust_scale

# A residual below this share of the cloud's radius is rounding: two equal clouds have met.
FLOOR_SHARE = 1e-10
# A step that moves the cloud by less than so many tolerances of its radius is the last one.
RESTING = 5.0


@dataclass(frozen=True)
class Alignments:
    """Results of ICP from s starts.

    Parameters
    ----------
    fixed_T_moving : ndarray, shape (s, 4, 4)
        Pose that each start ended in.
    rmse_mm : ndarray, shape (s,)
        Weighted root mean square residual at this pose in mm.
    iterations : ndarray of int, shape (s,)
        Number of steps taken.
    converged : ndarray of bool, shape (s,)
        Whether the start converged.
    """

    fixed_T_moving: Float64[np.ndarray, "s 4 4"]
    rmse_mm: Float64[np.ndarray, " s"]
    iterations: Int64[np.ndarray, " s"]
    converged: Bool[np.ndarray, " s"]


def align(
    moving_mm: Float64[np.ndarray, "n 3"],
    target: Target,
    starts: Float64[np.ndarray, "s 4 4"],
    *,
    max_iterations: int,
    tolerance: float,
    keep: float = 1.0,
    estimation: Estimation | None = None,
    kernel: RobustKernel | None = None,
    rejections: Sequence[Rejection] = (),
    moving_normals: Float64[np.ndarray, "n 3"] | None = None,
) -> Alignments:
    """Run ICP from every start at once.

    Parameters
    ----------
    moving_mm : ndarray, shape (n, 3)
        Moving points in mm.
    target : Target
        Fixed cloud.
    starts : ndarray, shape (s, 4, 4)
        Poses (fixed_T_moving) to start from.
    max_iterations : int
        Largest number of steps.
    tolerance : float
        Relative change of the residual below which a start has converged.
    keep : float, optional
        Share of the pairs with the smallest distances that counts.
    estimation : Estimation or None, optional
        Motion in a step; None takes point to plane if the target has normals, else point to point.
    kernel : RobustKernel or None, optional
        Robust kernel of the residuals; None gives all pairs full weight.
    rejections : sequence of Rejection, optional
        Rules that reject pairs.
    moving_normals : ndarray, shape (n, 3) or None, optional
        Unit normals of the moving points; None for none.

    Returns
    -------
    Alignments
        Poses, residuals and convergence of every start.

    Notes
    -----
    A start has converged once its weighted residual comes within ``tolerance`` of itself one or two steps
    before (trimming can end in two poses that alternate forever), or once a step moves the cloud by less than
    five tolerances of its radius. It then rests while the others continue.

    References
    ----------
    P. J. Besl and N. D. McKay, IEEE PAMI 14(2), 1992.
    """
    poses = np.array(starts, dtype=np.float64)
    count = len(poses)
    history_mm = np.full((2, count), np.inf)
    iterations, converged = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=bool)
    radius_mm = float(np.sqrt(moving_mm.var(axis=0).sum()))
    floor_mm = FLOOR_SHARE * radius_mm
    resting = np.zeros(count, dtype=bool)
    step: Estimation = estimation or (PointToPoint() if target.normals is None else PointToPlane())
    for iteration in range(max_iterations + 1):
        active = np.flatnonzero(~converged)
        pairs = closest_pairs(moving_mm, target, poses[active], moving_normals)
        residuals_mm = step.residuals_mm(pairs)
        weights = _weights(pairs, residuals_mm, keep, kernel, rejections, floor_mm)
        rmse_mm = np.sqrt(np.einsum("sn,sn,sn->s", weights, residuals_mm, residuals_mm) / weights.sum(axis=1))
        change_mm = np.abs(history_mm[:, active] - rmse_mm).min(axis=0)
        settled = resting[active] | (change_mm <= np.maximum(tolerance * rmse_mm, floor_mm))
        converged[active] = settled
        history_mm[:, active] = np.stack([rmse_mm, history_mm[0, active]])
        if iteration == max_iterations or settled.all():
            break
        on = active[~settled]
        motion = step.motion(_rows(pairs, ~settled), weights[~settled])
        poses[on] = motion @ poses[on]
        iterations[on] += 1
        centre_mm = pairs.moved_mm[~settled].mean(axis=1)
        resting[on] = _size_mm(motion, centre_mm, radius_mm) <= RESTING * tolerance * radius_mm
    return Alignments(poses, history_mm[0], iterations, converged)


def _size_mm(motion: np.ndarray, centre_mm: np.ndarray, radius_mm: float) -> Float64[np.ndarray, " s"]:
    """How far a small motion takes a cloud of that centre and radius, at most: its shift and its turn together."""
    shift_mm = (motion[:, :3, :3] @ centre_mm[..., None])[..., 0] + motion[:, :3, 3] - centre_mm
    # The Frobenius distance of a rotation from the identity is the square root of two times its angle.
    turn = np.linalg.norm(motion[:, :3, :3] - np.eye(3), axis=(1, 2)) / np.sqrt(2)
    return np.linalg.norm(shift_mm, axis=1) + radius_mm * turn


def _weights(
    pairs: Pairs,
    residuals_mm: np.ndarray,
    keep: float,
    kernel: RobustKernel | None,
    rejections: Sequence[Rejection],
    floor_mm: float,
) -> Float64[np.ndarray, "s n"]:
    """The product of all that may lower a pair's weight; a pose that would lose every pair keeps the closest three."""
    weights = trimming_weights(pairs.squared_mm2, keep)
    for rejection in rejections:
        weights = weights * rejection(pairs)
    if kernel is not None:
        weights = weights * kernel(residuals_mm / robust_scale(residuals_mm, floor_mm))
    bare = (weights > 0).sum(axis=1) < 3
    if bare.any():
        weights[bare] = trimming_weights(pairs.squared_mm2[bare], np.finfo(float).tiny)
    return weights


def _rows(pairs: Pairs, chosen: np.ndarray) -> Pairs:
    """The pairs of some of the poses."""
    if chosen.all():
        return pairs
    return Pairs(
        pairs.moved_mm[chosen],
        pairs.fixed_mm[chosen],
        None if pairs.normals is None else pairs.normals[chosen],
        None if pairs.moved_normals is None else pairs.moved_normals[chosen],
    )
