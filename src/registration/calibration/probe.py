"""Geometry of an affine probe calibration: pixel size, shear, and how far two calibrations differ."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64

from registration import transforms
from registration.errors import InputError


@dataclass(frozen=True)
class PixelGeometry:
    """Pixel size and shear of a calibration.

    Parameters
    ----------
    column_mm : float
        Step from one column to the next in mm.
    row_mm : float
        Step from one row to the next in mm.
    shear_deg : float
        Degrees by which the angle between the image's axes exceeds 90.
    """

    column_mm: float
    row_mm: float
    shear_deg: float


def pixel_geometry(probe_A_pixel: Float[np.ndarray, "4 4"]) -> PixelGeometry:
    """Compute the pixel size and shear of a calibration.

    Parameters
    ----------
    probe_A_pixel : ndarray, shape (4, 4)
        Affine matrix from pixels to the probe frame in mm.

    Returns
    -------
    PixelGeometry
        Pixel size and shear.

    Raises
    ------
    InputError
        If a pixel has no size.
    """
    column, row = np.asarray(probe_A_pixel, dtype=np.float64)[:3, :2].T
    column_mm, row_mm = float(np.linalg.norm(column)), float(np.linalg.norm(row))
    if not (column_mm > 0 and row_mm > 0):
        raise InputError(f"probe_A_pixel: expected pixels of a size, received {column_mm:g} by {row_mm:g} mm")
    cosine = float(np.clip(column @ row / (column_mm * row_mm), -1, 1))
    return PixelGeometry(column_mm, row_mm, float(np.rad2deg(np.arccos(cosine)) - 90))


def complete_right_handed(
    column_mm: Float[np.ndarray, "3"], row_mm: Float[np.ndarray, "3"], origin_mm: Float[np.ndarray, "3"]
) -> Float64[np.ndarray, "4 4"]:
    """Complete an image plane to an affine matrix whose third column is normal to the image, right-handed.

    Parameters
    ----------
    column_mm, row_mm : ndarray, shape (3,)
        Steps of one column and of one row in the probe frame in mm.
    origin_mm : ndarray, shape (3,)
        Position of the first pixel in mm.

    Returns
    -------
    ndarray, shape (4, 4)
        ``probe_A_pixel``. The normal's length is the mean of both steps, as in PLUS, so that a body carried
        through the matrix keeps its proportions.

    Raises
    ------
    InputError
        If the steps are parallel.
    """
    normal = np.cross(column_mm, row_mm)
    length = float(np.linalg.norm(normal))
    if not length > 0:
        raise InputError("column_mm, row_mm: expected two independent directions, received parallel ones")
    probe_A_pixel = np.eye(4)
    mean_step_mm = (np.linalg.norm(column_mm) + np.linalg.norm(row_mm)) / 2
    probe_A_pixel[:3] = np.stack([column_mm, row_mm, normal / length * mean_step_mm, origin_mm], axis=1)
    return probe_A_pixel


def with_third_column(probe_A_pixel: Float[np.ndarray, "4 4"]) -> Float64[np.ndarray, "4 4"]:
    """Complete a third column of zeros to a right-handed basis.

    Pixels lie in a plane, so the third column moves none of them; many laboratories leave it empty.

    Parameters
    ----------
    probe_A_pixel : ndarray, shape (4, 4)
        Affine matrix from pixels to the probe frame in mm.

    Returns
    -------
    ndarray, shape (4, 4)
        The completed matrix; one with a third column is returned as it is.
    """
    if np.any(probe_A_pixel[:3, 2]):
        return np.asarray(probe_A_pixel, dtype=np.float64)
    completed = complete_right_handed(probe_A_pixel[:3, 0], probe_A_pixel[:3, 1], probe_A_pixel[:3, 3])
    completed[3] = probe_A_pixel[3]
    return completed


def split_rigid(
    probe_A_pixel: Float[np.ndarray, "4 4"], shear_tolerance_deg: float
) -> tuple[Float64[np.ndarray, "4 4"], tuple[float, float]]:
    """Split a calibration without shear into a rigid transform and the pixel spacing.

    Parameters
    ----------
    probe_A_pixel : ndarray, shape (4, 4)
        Affine matrix from pixels to the probe frame in mm.
    shear_tolerance_deg : float
        Largest shear in degrees.

    Returns
    -------
    probe_T_image : ndarray, shape (4, 4)
        Rigid transform in mm.
    spacing_mm : tuple[float, float]
        Column and row spacing in mm.

    Raises
    ------
    InputError
        If the image's axes are further from orthogonal.
    """
    geometry = pixel_geometry(probe_A_pixel)
    if abs(geometry.shear_deg) > shear_tolerance_deg:
        raise InputError(
            f"probe_A_pixel: expected image axes orthogonal within {shear_tolerance_deg:g} degrees, "
            f"received a shear of {geometry.shear_deg:.3g} degrees"
        )
    matrix = np.asarray(probe_A_pixel, dtype=np.float64)
    unit = complete_right_handed(
        matrix[:3, 0] / geometry.column_mm, matrix[:3, 1] / geometry.row_mm, matrix[:3, 3]
    )
    return transforms.nearest_rigid(unit), (geometry.column_mm, geometry.row_mm)


def corner_displacement_mm(
    a_A_pixel: Float[np.ndarray, "4 4"], b_A_pixel: Float[np.ndarray, "4 4"], height_px: int, width_px: int
) -> Float64[np.ndarray, "4"]:
    """Measure the displacement of the image's corner pixels between two calibrations.

    Parameters
    ----------
    a_A_pixel, b_A_pixel : ndarray, shape (4, 4)
        Affine matrices from pixels to one frame in mm.
    height_px, width_px : int
        Size of the image in px.

    Returns
    -------
    ndarray, shape (4,)
        Distances in mm: top left, top right, bottom left, bottom right.
    """
    right, bottom = width_px - 1, height_px - 1
    corners = np.array([[0, 0, 0], [right, 0, 0], [0, bottom, 0], [right, bottom, 0]], dtype=np.float64)
    return np.linalg.norm(transforms.apply(a_A_pixel, corners) - transforms.apply(b_A_pixel, corners), axis=1)
