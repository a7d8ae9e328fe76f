"""Estimation: the rigid motion that brings weighted pairs closer, for many poses at once.

Kabsch, Acta Cryst. A32, 1976 and Umeyama, IEEE PAMI 13(4), 1991 (point to point); Chen and Medioni, Image Vision
Comput. 10(3), 1992 (point to plane); Rusinkiewicz, ACM Trans. Graph. 38(4), 2019 (symmetric).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.checks import require_at_least
from registration.errors import InputError
from registration.geometry.rigid_fit import kabsch
from registration.rigid.icp.pairs import Pairs

# Directions of motion whose stiffness is below this share of the stiffest are left alone by a step along normals.
STIFFNESS_SHARE = 1e-6
# A step along normals is linear in the rotation: it moves the cloud by at most this share of its radius.
LONGEST_STEP = 0.5


@runtime_checkable
class Estimation(Protocol):
    """Residual that a step of ICP minimises, and the step."""

    def residuals_mm(self, pairs: Pairs) -> Float64[np.ndarray, "s n"]:
        """Compute the residual of each pair.

        Parameters
        ----------
        pairs : Pairs
            Pairs of s poses and n points.

        Returns
        -------
        ndarray, shape (s, n)
            Residuals in mm.
        """
        ...

    def motion(self, pairs: Pairs, weights: Float64[np.ndarray, "s n"]) -> Float64[np.ndarray, "s 4 4"]:
        """Compute the rigid motion that makes the weighted residuals smaller.

        Parameters
        ----------
        pairs : Pairs
            Pairs of s poses and n points.
        weights : ndarray, shape (s, n)
            Weight of each pair.

        Returns
        -------
        ndarray, shape (s, 4, 4)
            Motion (fixed_T_fixed) of the moved points for each pose.
        """
        ...


@dataclass(frozen=True)
class PointToPoint:
    """Minimisation of the distance between paired points."""

    def residuals_mm(self, pairs: Pairs) -> Float64[np.ndarray, "s n"]:
        """Compute the distance of each pair.

        Parameters
        ----------
        pairs : Pairs
            Pairs of s poses and n points.

        Returns
        -------
        ndarray, shape (s, n)
            Distances in mm.
        """
        return np.sqrt(pairs.squared_mm2)

    def motion(self, pairs: Pairs, weights: Float64[np.ndarray, "s n"]) -> Float64[np.ndarray, "s 4 4"]:
        """Compute the least-squares motion.

        Parameters
        ----------
        pairs : Pairs
            Pairs of s poses and n points.
        weights : ndarray, shape (s, n)
            Weight of each pair.

        Returns
        -------
        ndarray, shape (s, 4, 4)
            Motion (fixed_T_fixed) of the moved points for each pose.
        """
        return kabsch(pairs.moved_mm, pairs.fixed_mm, weights)


@dataclass(frozen=True)
class PointToPlane:
    """Minimisation of the distance from each point to the plane through its paired one.

    Parameters
    ----------
    damping : float, optional
        Levenberg damping as a share of the mean stiffness, from 0. It keeps a step far from the solution from
        running along a direction that the normals leave almost free.
    offset : bool, optional
        Whether one wall may lie outside the other by the same distance everywhere, as the borders of two
        modalities do: it is then estimated with the motion, and no residual. On a vessel that tapers it would
        otherwise be taken for a slide. Normals must then all point to the same side.

    Raises
    ------
    InputError
        If the damping is negative.
    """

    damping: float = 0.0
    offset: bool = False

    def __post_init__(self) -> None:
        require_at_least("damping", self.damping, 0.0)

    def residuals_mm(self, pairs: Pairs) -> Float64[np.ndarray, "s n"]:
        """Compute the distance of each pair along the fixed point's normal.

        Parameters
        ----------
        pairs : Pairs
            Pairs of s poses and n points.

        Returns
        -------
        ndarray, shape (s, n)
            Signed distances in mm.

        Raises
        ------
        InputError
            If the fixed cloud has no normals.
        """
        return _along(pairs, _fixed_normals(pairs), self.offset)

    def motion(self, pairs: Pairs, weights: Float64[np.ndarray, "s n"]) -> Float64[np.ndarray, "s 4 4"]:
        """Compute one Gauss-Newton step; it does not move along a direction that the normals leave free.

        Parameters
        ----------
        pairs : Pairs
            Pairs of s poses and n points.
        weights : ndarray, shape (s, n)
            Weight of each pair.

        Returns
        -------
        ndarray, shape (s, 4, 4)
            Motion (fixed_T_fixed) of the moved points for each pose.

        Raises
        ------
        InputError
            If the fixed cloud has no normals.
        """
        return _newton(pairs, _fixed_normals(pairs), weights, self.damping, self.offset)


@dataclass(frozen=True)
class Symmetric:
    """Minimisation of the distance of both points from the plane between them.

    It is right to second order where both surfaces are curved. The plane's normal is the mean of both
    normals, whose signs are made to agree.

    Parameters
    ----------
    damping : float, optional
        Levenberg damping; see ``PointToPlane``.
    offset : bool, optional
        Whether a constant offset between the walls is estimated; see ``PointToPlane``.

    Raises
    ------
    InputError
        If the damping is negative.
    """

    damping: float = 0.0
    offset: bool = False

    def __post_init__(self) -> None:
        require_at_least("damping", self.damping, 0.0)

    def residuals_mm(self, pairs: Pairs) -> Float64[np.ndarray, "s n"]:
        """Compute the distance of each pair along the mean normal.

        Parameters
        ----------
        pairs : Pairs
            Pairs of s poses and n points.

        Returns
        -------
        ndarray, shape (s, n)
            Signed distances in mm.

        Raises
        ------
        InputError
            If either cloud has no normals.
        """
        return _along(pairs, _mean_normals(pairs), self.offset)

    def motion(self, pairs: Pairs, weights: Float64[np.ndarray, "s n"]) -> Float64[np.ndarray, "s 4 4"]:
        """Compute one Gauss-Newton step.

        Parameters
        ----------
        pairs : Pairs
            Pairs of s poses and n points.
        weights : ndarray, shape (s, n)
            Weight of each pair.

        Returns
        -------
        ndarray, shape (s, 4, 4)
            Motion (fixed_T_fixed) of the moved points for each pose.

        Raises
        ------
        InputError
            If either cloud has no normals.
        """
        return _newton(pairs, _mean_normals(pairs), weights, self.damping, self.offset)


def motion_jacobian(
    arms: Float64[np.ndarray, "*s n 3"], normals: Float64[np.ndarray, "*s n 3"]
) -> Float64[np.ndarray, "*s n 6"]:
    """Compute how far each point moves along its normal in a small motion.

    Parameters
    ----------
    arms : ndarray, shape (..., n, 3)
        Points about the centre of rotation, in the unit in which rotations are to be measured.
    normals : ndarray, shape (..., n, 3)
        Unit normals.

    Returns
    -------
    ndarray, shape (..., n, 6)
        Derivatives by the rotation (first three) and the translation (last three).
    """
    jacobian = np.empty((*arms.shape[:-1], 6))
    # Written out: np.cross takes several times as long.
    for axis, (one, two) in enumerate(((1, 2), (2, 0), (0, 1))):
        jacobian[..., axis] = arms[..., one] * normals[..., two] - arms[..., two] * normals[..., one]
    jacobian[..., 3:] = normals
    return jacobian


def motion_transforms(
    motion_mm: Float64[np.ndarray, "s 6"],
    centre_mm: Float64[np.ndarray, "*c 3"],
    radius_mm: float | Float64[np.ndarray, "s 1"],
) -> Float64[np.ndarray, "s 4 4"]:
    """Turn small motions in the unknowns of ``motion_jacobian`` into transforms.

    Parameters
    ----------
    motion_mm : ndarray, shape (s, 6)
        Rotation vectors times the radius, and translations, in mm.
    centre_mm : ndarray, shape (3,) or (s, 3)
        Centre of rotation in mm in the fixed coordinate frame, of all motions or of each.
    radius_mm : float or ndarray, shape (s, 1)
        Radius of the cloud in mm, the unit in which rotations are measured.

    Returns
    -------
    ndarray, shape (s, 4, 4)
        Transforms (fixed_T_fixed).
    """
    turn = Rotation.from_rotvec(motion_mm[:, :3] / radius_mm)
    return transforms.from_rotation(turn, centre_mm + motion_mm[:, 3:] - turn.apply(centre_mm))


def _newton(
    pairs: Pairs, normals: np.ndarray, weights: np.ndarray, damping: float, offset: bool
) -> Float64[np.ndarray, "s 4 4"]:
    centre_mm = pairs.moved_mm.mean(axis=1, keepdims=True)
    arms_mm = pairs.moved_mm - centre_mm
    # Angles are scaled by the cloud's radius so that all six unknowns are lengths and one cut-off serves them.
    radius_mm = np.sqrt(np.einsum("snk,snk->s", arms_mm, arms_mm) / arms_mm.shape[1])[:, None]
    jacobian = motion_jacobian(arms_mm / radius_mm[..., None], normals)
    if offset:
        jacobian = with_offset(jacobian)
    weighted = np.swapaxes(jacobian * weights[..., None], 1, 2)
    stiffness = weighted @ jacobian
    unknowns = stiffness.shape[1]
    mean = np.trace(stiffness, axis1=1, axis2=2)[:, None, None] / unknowns
    pull = weighted @ _along(pairs, normals)[..., None]
    damped = stiffness + damping * mean * np.eye(unknowns)
    inverse = np.linalg.pinv(damped, rcond=STIFFNESS_SHARE, hermitian=True)
    motion_mm = (inverse @ pull)[:, :6, 0]
    longest_mm = np.abs(motion_mm).max(axis=1, keepdims=True)
    motion_mm *= LONGEST_STEP * radius_mm / np.maximum(longest_mm, LONGEST_STEP * radius_mm)
    return motion_transforms(motion_mm, centre_mm[:, 0], radius_mm)


def with_offset(jacobian: Float64[np.ndarray, "*s n 6"]) -> Float64[np.ndarray, "*s n 7"]:
    """Add one unknown to a Jacobian, by which all points are displaced along their normals.

    Parameters
    ----------
    jacobian : ndarray, shape (..., n, 6)
        Derivatives by rotation and translation.

    Returns
    -------
    ndarray, shape (..., n, 7)
        Derivatives with those by the offset last.
    """
    return np.concatenate([jacobian, np.ones_like(jacobian[..., :1])], axis=-1)


def _along(pairs: Pairs, normals: np.ndarray, offset: bool = False) -> Float64[np.ndarray, "s n"]:
    gap_mm = np.einsum("snk,snk->sn", pairs.offset_mm, normals)
    return gap_mm - np.median(gap_mm, axis=1, keepdims=True) if offset else gap_mm


def _fixed_normals(pairs: Pairs) -> np.ndarray:
    if pairs.normals is None:
        raise InputError("pairs: expected normals of the fixed cloud for a step along them, received none")
    return pairs.normals


def _mean_normals(pairs: Pairs) -> np.ndarray:
    fixed = _fixed_normals(pairs)
    if pairs.moved_normals is None:
        raise InputError("pairs: expected normals of both clouds for a symmetric step, received none")
    agree = np.sign(np.einsum("snk,snk->sn", fixed, pairs.moved_normals))[..., None]
    summed = fixed + np.where(agree == 0, 1.0, agree) * pairs.moved_normals
    return summed / np.linalg.norm(summed, axis=2, keepdims=True)
