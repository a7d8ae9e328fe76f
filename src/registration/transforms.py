"""Rigid and affine transforms between named frames.

``A_T_B`` is a rigid 4x4 float64 matrix that maps coordinates in frame B to coordinates in frame A,
``p_A = A_T_B @ p_B``; ``A_A_B`` is the affine one. Lengths are millimetres. Every function works on one
matrix or on a stack of them along leading axes.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float64
from scipy.spatial.transform import Rotation, Slerp

from registration.errors import InputError

# A pose written with six significant digits (as PLUS writes them) has rotation entries wrong by up to 5e-7
# relative, so its Gram matrix is off by about 2e-6; a matrix that is off by 1e-3 was never meant to be rigid.
RIGID_TOLERANCE = 1e-3
# Axes that span less than this share of the volume they would span at right angles lie in a plane but for rounding.
FLAT_SHARE = 1e-12


def compose(*transforms: Float[np.ndarray, "... 4 4"]) -> Float64[np.ndarray, "... 4 4"]:
    """Chain transforms from left to right: ``compose(A_T_B, B_T_C)`` is ``A_T_C``.

    Parameters
    ----------
    *transforms : ndarray, shape (..., 4, 4)
        At least one transform; stacks broadcast against single matrices.

    Returns
    -------
    ndarray, shape (..., 4, 4)
        Their product.

    Raises
    ------
    InputError
        If no transform is given.

    Examples
    --------
    >>> compose(translation((1, 0, 0)), translation((0, 2, 0)))[:3, 3].tolist()
    [1.0, 2.0, 0.0]
    """
    if not transforms:
        raise InputError("compose: expected at least one transform, received none")
    chained = np.asarray(transforms[0], dtype=np.float64)
    for transform in transforms[1:]:
        chained = chained @ np.asarray(transform, dtype=np.float64)
    return chained


def invert_rigid(A_T_B: Float[np.ndarray, "*n 4 4"]) -> Float64[np.ndarray, "*n 4 4"]:
    """Invert rigid transforms by transposing the rotation, exact where a general inverse would round.

    Parameters
    ----------
    A_T_B : ndarray, shape (..., 4, 4)
        Rigid transforms.

    Returns
    -------
    ndarray, shape (..., 4, 4)
        ``B_T_A``.
    """
    A_T_B = np.asarray(A_T_B, dtype=np.float64)
    rotation_transposed = np.swapaxes(A_T_B[..., :3, :3], -1, -2)
    inverse = np.zeros_like(A_T_B)
    inverse[..., :3, :3] = rotation_transposed
    inverse[..., :3, 3] = -(rotation_transposed @ A_T_B[..., :3, 3:])[..., 0]
    inverse[..., 3, 3] = 1.0
    return inverse


def invert_affine(A_A_B: Float[np.ndarray, "*n 4 4"], name: str = "A_A_B") -> Float64[np.ndarray, "*n 4 4"]:
    """Invert affine transforms.

    Parameters
    ----------
    A_A_B : ndarray, shape (..., 4, 4)
        Affine transforms.
    name : str, optional
        Their name, for messages.

    Returns
    -------
    ndarray, shape (..., 4, 4)
        ``B_A_A``.

    Raises
    ------
    InputError
        If a matrix is not affine or has no inverse.
    """
    A_A_B = require_affine(A_A_B, name)
    return np.linalg.inv(A_A_B)


def apply(
    A_A_B: Float[np.ndarray, "4 4"], points_B: Float[np.ndarray, "*n 3"]
) -> Float64[np.ndarray, "*n 3"]:
    """Map points by one rigid or affine transform.

    Parameters
    ----------
    A_A_B : ndarray, shape (4, 4)
        Transform from coordinate frame B to A.
    points_B : ndarray, shape (..., 3)
        Points in B.

    Returns
    -------
    ndarray, shape (..., 3)
        The points in A.
    """
    A_A_B = np.asarray(A_A_B, dtype=np.float64)
    return np.asarray(points_B, dtype=np.float64) @ A_A_B[:3, :3].T + A_A_B[:3, 3]


def apply_each(
    A_A_B: Float[np.ndarray, "n 4 4"], points_B: Float[np.ndarray, "n 3"]
) -> Float64[np.ndarray, "n 3"]:
    """Map each point by a transform of its own, in one vectorised step.

    Parameters
    ----------
    A_A_B : ndarray, shape (n, 4, 4)
        Transforms from coordinate frame B to A.
    points_B : ndarray, shape (n, 3)
        Points in B, one for each transform.

    Returns
    -------
    ndarray, shape (n, 3)
        The points in A.
    """
    A_A_B = np.asarray(A_A_B, dtype=np.float64)
    return np.einsum("nij,nj->ni", A_A_B[:, :3, :3], points_B) + A_A_B[:, :3, 3]


def translation(offset_mm: tuple[float, float, float] | Float[np.ndarray, "3"]) -> Float64[np.ndarray, "4 4"]:
    """Make the rigid transform that only moves.

    Parameters
    ----------
    offset_mm : array_like, shape (3,)
        Translation in mm.

    Returns
    -------
    ndarray, shape (4, 4)
        Rigid transform.
    """
    A_T_B = np.eye(4)
    A_T_B[:3, 3] = offset_mm
    return A_T_B


def from_rotation(
    rotation: Rotation, translation_mm: Float[np.ndarray, "... 3"]
) -> Float64[np.ndarray, "... 4 4"]:
    """Join rotations and translations into rigid transforms.

    Parameters
    ----------
    rotation : Rotation
        One rotation of SciPy's, or a stack.
    translation_mm : ndarray, shape (..., 3)
        Translations in mm; one of either goes with a stack of both.

    Returns
    -------
    ndarray, shape (..., 4, 4)
        Rigid transforms.
    """
    matrix = rotation.as_matrix()
    translation_mm = np.asarray(translation_mm, dtype=np.float64)
    A_T_B = np.zeros((*np.broadcast_shapes(matrix.shape[:-2], translation_mm.shape[:-1]), 4, 4))
    A_T_B[..., :3, :3] = matrix
    A_T_B[..., :3, 3] = translation_mm
    A_T_B[..., 3, 3] = 1.0
    return A_T_B


def rotate_about(rotation: Rotation, centre_mm: Float[np.ndarray, "3"]) -> Float64[np.ndarray, "4 4"]:
    """Make the rigid transform that rotates about a point.

    Parameters
    ----------
    rotation : Rotation
        Rotation of SciPy's.
    centre_mm : ndarray, shape (3,)
        Point in mm that stays where it is.

    Returns
    -------
    ndarray, shape (4, 4)
        Rigid transform.
    """
    centre_mm = np.asarray(centre_mm, dtype=np.float64)
    return from_rotation(rotation, centre_mm - rotation.apply(centre_mm))


def require_affine(A_A_B: Float[np.ndarray, "*n 4 4"], name: str) -> Float64[np.ndarray, "*n 4 4"]:
    """Return affine transforms as float64, or raise InputError that names the first defect found.

    Parameters
    ----------
    A_A_B : ndarray, shape (..., 4, 4)
        Matrices to check.
    name : str
        Their name, for messages.

    Returns
    -------
    ndarray, shape (..., 4, 4)
        The same matrices.

    Raises
    ------
    InputError
        If an entry is not finite, the last row is not 0 0 0 1, or a matrix has no inverse.
    """
    A_A_B = np.asarray(A_A_B, dtype=np.float64)
    if A_A_B.shape[-2:] != (4, 4):
        raise InputError(f"{name}: expected shape (..., 4, 4), received {A_A_B.shape}")
    broken = ~np.isfinite(A_A_B).all(axis=(-1, -2))
    if broken.any():
        raise InputError(f"{name}: expected finite entries, received NaN or infinity{_where(broken)}")
    wrong_row = (np.abs(A_A_B[..., 3, :] - np.array([0.0, 0.0, 0.0, 1.0])) > 1e-9).any(axis=-1)
    if wrong_row.any():
        raise InputError(f"{name}: expected last row 0 0 0 1, received another{_where(wrong_row)}")
    # Against the product of the axes' lengths, so that the result does not depend on the unit of a pixel.
    lengths = np.linalg.norm(A_A_B[..., :3, :3], axis=-2).prod(axis=-1)
    flat = np.abs(np.linalg.det(A_A_B[..., :3, :3])) <= FLAT_SHARE * lengths
    if flat.any():
        raise InputError(f"{name}: expected an invertible matrix, received one without inverse{_where(flat)}")
    return A_A_B


def is_affine(A_A_B: Float[np.ndarray, "4 4"]) -> bool:
    """Tell whether a matrix is finite, has the last row 0 0 0 1 and an inverse.

    Parameters
    ----------
    A_A_B : ndarray, shape (4, 4)
        Matrix.

    Returns
    -------
    bool
        Whether it is affine.
    """
    try:
        require_affine(A_A_B, "A_A_B")
    except InputError:
        return False
    return True


def require_rigid(
    A_T_B: Float[np.ndarray, "*n 4 4"], name: str, tolerance: float = RIGID_TOLERANCE
) -> Float64[np.ndarray, "*n 4 4"]:
    """Return rigid transforms as float64, or raise InputError that names the first defect found.

    Parameters
    ----------
    A_T_B : ndarray, shape (..., 4, 4)
        Matrices to check.
    name : str
        Their name, for messages.
    tolerance : float, optional
        Largest entry allowed of ``R.T @ R - I`` (no unit).

    Returns
    -------
    ndarray, shape (..., 4, 4)
        The same matrices.

    Raises
    ------
    InputError
        If a matrix is not a right-handed rotation and a translation.
    """
    A_T_B = require_affine(A_T_B, name)
    rotation = A_T_B[..., :3, :3]
    left_handed = np.linalg.det(rotation) < 0
    if left_handed.any():
        raise InputError(
            f"{name}: expected a right-handed rotation, received a mirrored one{_where(left_handed)}"
        )
    defect = np.abs(np.swapaxes(rotation, -1, -2) @ rotation - np.eye(3)).max(axis=(-1, -2))
    if (defect > tolerance).any():
        raise InputError(
            f"{name}: expected orthonormal rotations within {tolerance:g}, "
            f"received a defect of {defect.max():.3g}{_where(defect > tolerance)}"
        )
    return A_T_B


def nearest_rigid(A_A_B: Float[np.ndarray, "*n 4 4"]) -> Float64[np.ndarray, "*n 4 4"]:
    """Replace the linear part by the nearest rotation in the Frobenius norm (polar decomposition by SVD).

    Parameters
    ----------
    A_A_B : ndarray, shape (..., 4, 4)
        Transforms that are nearly rigid.

    Returns
    -------
    ndarray, shape (..., 4, 4)
        Rigid transforms with the same translations.
    """
    A_T_B = np.array(A_A_B, dtype=np.float64)
    left, _, right = np.linalg.svd(A_T_B[..., :3, :3])
    sign = np.sign(np.linalg.det(left @ right))
    left[..., :, 2] *= sign[..., None]
    A_T_B[..., :3, :3] = left @ right
    return A_T_B


def rotation_angle_deg(A_T_B: Float[np.ndarray, "*n 4 4"]) -> Float64[np.ndarray, " *n"]:
    """Compute the angle by which each transform rotates.

    Parameters
    ----------
    A_T_B : ndarray, shape (..., 4, 4)
        Rigid transforms.

    Returns
    -------
    ndarray, shape (...)
        Angles, 0 to 180 deg.
    """
    A_T_B = np.asarray(A_T_B, dtype=np.float64)
    flat = Rotation.from_matrix(A_T_B[..., :3, :3].reshape(-1, 3, 3)).magnitude()
    return np.rad2deg(flat).reshape(A_T_B.shape[:-2])


def interpolate(
    times_s: Float[np.ndarray, " n"],
    known_times_s: Float[np.ndarray, " m"],
    A_T_B: Float[np.ndarray, "m 4 4"],
) -> Float64[np.ndarray, "n 4 4"]:
    """Interpolate poses: SLERP for rotation, linear for translation; nothing is extrapolated.

    Parameters
    ----------
    times_s : ndarray, shape (n,)
        Times in s at which poses are wanted, within ``known_times_s``.
    known_times_s : ndarray, shape (m,)
        Times of the known poses in s, strictly increasing, at least two.
    A_T_B : ndarray, shape (m, 4, 4)
        Known rigid poses.

    Returns
    -------
    ndarray, shape (n, 4, 4)
        Poses at ``times_s``.

    Raises
    ------
    InputError
        If poses are not rigid or not as many as their times, times are out of order, or one lies outside.
    """
    known_times_s = np.asarray(known_times_s, dtype=np.float64)
    times_s = np.asarray(times_s, dtype=np.float64)
    A_T_B = require_rigid(A_T_B, "A_T_B")
    if len(A_T_B) != len(known_times_s):
        raise InputError(
            f"A_T_B: expected one pose for each of {len(known_times_s)} times, received {len(A_T_B)}"
        )
    # Written so that a NaN, which compares false to everything, is refused too.
    if len(known_times_s) < 2 or not (np.diff(known_times_s) > 0).all():
        raise InputError("known_times_s: expected at least two strictly increasing times, received otherwise")
    if len(times_s) == 0:
        return np.empty((0, 4, 4))
    if not (times_s.min() >= known_times_s[0] and times_s.max() <= known_times_s[-1]):
        raise InputError(
            f"times_s: expected times within {known_times_s[0]:g} to {known_times_s[-1]:g} s, "
            f"received {times_s.min():g} to {times_s.max():g} s"
        )
    rotations = Slerp(known_times_s, Rotation.from_matrix(A_T_B[:, :3, :3]))(times_s)
    position_mm = np.stack(
        [np.interp(times_s, known_times_s, A_T_B[:, axis, 3]) for axis in range(3)], axis=-1
    )
    return from_rotation(rotations, position_mm)


def mean_rigid(A_T_B: Float[np.ndarray, "n 4 4"]) -> Float64[np.ndarray, "4 4"]:
    """Average poses: chordal mean of the rotations, arithmetic mean of the translations.

    Parameters
    ----------
    A_T_B : ndarray, shape (n, 4, 4)
        Rigid poses, at least one.

    Returns
    -------
    ndarray, shape (4, 4)
        Mean pose.

    Raises
    ------
    InputError
        If there is no pose.
    """
    A_T_B = require_rigid(A_T_B, "A_T_B")
    if not len(A_T_B):
        raise InputError("A_T_B: expected at least one pose to average, received none")
    return from_rotation(Rotation.from_matrix(A_T_B[:, :3, :3]).mean(), A_T_B[:, :3, 3].mean(axis=0))


def _where(defective: np.ndarray | np.bool_) -> str:
    """Name the first defective matrix of a stack (one truth value a matrix); nothing for a single one."""
    if np.ndim(defective) == 0:
        return ""
    return f" (matrix {', '.join(str(index) for index in np.argwhere(defective)[0])})"
