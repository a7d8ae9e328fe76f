"""The rigid transform that brings paired points closest, in closed form."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64


def kabsch(
    moving_mm: Float64[np.ndarray, "*s n 3"],
    fixed_mm: Float64[np.ndarray, "*s n 3"],
    weights: Float64[np.ndarray, "*s n"] | None = None,
) -> Float64[np.ndarray, "*s 4 4"]:
    """Compute the rigid transforms, never mirrored, that fit paired points in weighted least squares.

    Parameters
    ----------
    moving_mm : ndarray, shape (..., n, 3)
        Moving points in mm.
    fixed_mm : ndarray, shape (..., n, 3)
        Their paired fixed points in mm.
    weights : ndarray, shape (..., n), or None, optional
        Weight of each pair; None weighs all alike.

    Returns
    -------
    ndarray, shape (..., 4, 4)
        Rigid transforms ``fixed_T_moving``.

    References
    ----------
    W. Kabsch, Acta Cryst. A32, 1976.

    K. S. Arun et al., IEEE PAMI 9(5), 1987.

    S. Umeyama, IEEE PAMI 13(4), 1991.
    """
    if weights is None:
        weights = np.ones(moving_mm.shape[:-1])
    share = (weights / weights.sum(axis=-1, keepdims=True))[..., None]
    moving_centre_mm = (share * moving_mm).sum(axis=-2)
    fixed_centre_mm = (share * fixed_mm).sum(axis=-2)
    covariance = np.swapaxes(share * (moving_mm - moving_centre_mm[..., None, :]), -1, -2) @ (
        fixed_mm - fixed_centre_mm[..., None, :]
    )
    left, _, right = np.linalg.svd(covariance)
    left[..., :, 2] *= np.sign(np.linalg.det(left) * np.linalg.det(right))[..., None]
    rotation = np.swapaxes(left @ right, -1, -2)
    fixed_T_moving = np.zeros((*rotation.shape[:-2], 4, 4))
    fixed_T_moving[..., :3, :3] = rotation
    fixed_T_moving[..., :3, 3] = fixed_centre_mm - (rotation @ moving_centre_mm[..., None])[..., 0]
    fixed_T_moving[..., 3, 3] = 1.0
    return fixed_T_moving
