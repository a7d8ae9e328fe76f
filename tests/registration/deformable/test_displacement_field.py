"""Derivative, plausibility and inverse of displacements that are known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from registration.deformable.displacement_field import gradient, inverse_displacement, plausibility
from registration.errors import InputError

POINTS = np.random.default_rng(0).uniform(-20.0, 20.0, (60, 3))
LENGTH_MM = 12.0


def waves(points_mm: np.ndarray, size_mm: float = 2.0) -> np.ndarray:
    """A smooth displacement whose components each depend on another coordinate."""
    return size_mm * np.sin(points_mm[:, [1, 2, 0]] / LENGTH_MM)


def test_gradient_is_the_derivative() -> None:
    expected = np.zeros((len(POINTS), 3, 3))
    for row, column in ((0, 1), (1, 2), (2, 0)):
        expected[:, row, column] = 2.0 / LENGTH_MM * np.cos(POINTS[:, column] / LENGTH_MM)
    np.testing.assert_allclose(gradient(waves, POINTS), expected, atol=1e-6)


def test_a_rotation_strains_nothing() -> None:
    turn = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()
    found = plausibility(lambda points_mm: points_mm @ turn.T - points_mm + [1.0, 2.0, 3.0], POINTS)
    assert found.strain_max == pytest.approx(0.0, abs=1e-9)
    assert found.jacobian_min == pytest.approx(1.0)
    assert found.bending_energy_per_mm2 == pytest.approx(0.0, abs=1e-12)
    assert not found.folds


def test_a_dilation_has_its_strain_and_volume() -> None:
    found = plausibility(lambda points_mm: 0.1 * points_mm, POINTS)
    # Green and Lagrange: (1.1² - 1) / 2.
    assert found.strain_max == pytest.approx(0.105) and found.strain_p95 == pytest.approx(0.105)
    assert found.jacobian_min == pytest.approx(1.1**3)


def test_bending_energy_is_that_of_the_second_derivatives() -> None:
    found = plausibility(lambda points_mm: 0.01 * points_mm[:, [0]] ** 2 * [1.0, 0.0, 0.0], POINTS)
    assert found.bending_energy_per_mm2 == pytest.approx(0.02**2, rel=1e-4)


def test_a_mirror_image_folds() -> None:
    assert plausibility(lambda points_mm: points_mm * [-2.0, 0.0, 0.0], POINTS).folds


def test_the_inverse_leads_back() -> None:
    there_mm = POINTS + waves(POINTS)
    np.testing.assert_allclose(there_mm + inverse_displacement(waves, there_mm), POINTS, atol=1e-5)
    assert np.abs(-waves(there_mm) - (POINTS - there_mm)).max() > 0.1  # the plain negative does not


def test_a_field_that_folds_has_no_inverse() -> None:
    with pytest.raises(InputError, match="expected a field that can be inverted"):
        inverse_displacement(lambda points_mm: waves(points_mm, 40.0), POINTS)
