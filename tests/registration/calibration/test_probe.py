"""Pixel size, shear and difference of calibrations, from matrices built by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.calibration.probe import (
    complete_right_handed,
    corner_displacement_mm,
    pixel_geometry,
    split_rigid,
)
from registration.errors import InputError

TURN = Rotation.from_euler("xyz", [30, -50, 70], degrees=True).as_matrix()


def sheared(angle_deg: float) -> np.ndarray:
    """Columns 0.1 mm apart, rows 0.3 mm, the axes at 90 degrees plus ``angle_deg``, turned obliquely and shifted."""
    angle = np.deg2rad(90 + angle_deg)
    row = 0.3 * np.array([np.cos(angle), np.sin(angle), 0.0])
    return complete_right_handed(TURN @ [0.1, 0.0, 0.0], TURN @ row, np.array([5.0, -6.0, 7.0]))


@pytest.mark.parametrize("angle_deg", [0.0, 2.7, -8.0])
def test_scale_and_shear(angle_deg: float) -> None:
    geometry = pixel_geometry(sheared(angle_deg))
    assert geometry.column_mm == pytest.approx(0.1)
    assert geometry.row_mm == pytest.approx(0.3)
    assert geometry.shear_deg == pytest.approx(angle_deg, abs=1e-9)


def test_third_column_completes_a_right_handed_basis() -> None:
    matrix = sheared(2.7)
    assert np.linalg.det(matrix[:3, :3]) > 0
    np.testing.assert_allclose(matrix[:3, 2], 0.2 * TURN[:, 2], atol=1e-12)
    flipped = complete_right_handed(matrix[:3, 1], matrix[:3, 0], matrix[:3, 3])
    np.testing.assert_allclose(flipped[:3, 2], -matrix[:3, 2], atol=1e-12)
    assert np.linalg.det(flipped[:3, :3]) > 0


def test_split_into_rigid_and_spacing() -> None:
    probe_T_image, (column_mm, row_mm) = split_rigid(sheared(0.0), shear_tolerance_deg=0.5)
    np.testing.assert_allclose(probe_T_image[:3, :3], TURN, atol=1e-12)
    np.testing.assert_allclose(probe_T_image[:3, 3], [5, -6, 7])
    assert (column_mm, row_mm) == pytest.approx((0.1, 0.3))


def test_shear_cannot_be_split() -> None:
    with pytest.raises(InputError, match=r"orthogonal within 0\.5 degrees, received a shear of 2\.7 degrees"):
        split_rigid(sheared(2.7), shear_tolerance_deg=0.5)


def test_corner_displacement() -> None:
    # A turn by a small angle about the image's origin moves a corner by its distance times the angle.
    before = np.diag([0.1, 0.2, 0.15, 1.0])
    after = transforms.rotate_about(Rotation.from_euler("z", 1e-4), np.zeros(3)) @ before
    expected = 1e-4 * np.hypot([0, 10, 0, 10], [0, 0, 30, 30])
    np.testing.assert_allclose(corner_displacement_mm(before, after, 151, 101), expected, rtol=1e-6)


def test_flat_images_are_refused() -> None:
    with pytest.raises(InputError, match="two independent directions"):
        complete_right_handed(np.array([1.0, 0, 0]), np.array([2.0, 0, 0]), np.zeros(3))
    with pytest.raises(InputError, match="expected pixels of a size"):
        pixel_geometry(np.diag([0.1, 0.0, 0.1, 1.0]))
