"""Fits under a covariance against independent formulas, and sizes found again that were put in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.stats import multivariate_normal
from tube_residuals import BARE, PARTS, POINTS_MM, TARGET

from registration import transforms
from registration.rigid.residual_model.covariance import CovarianceParts, Ratios, matern
from registration.rigid.residual_model.grouped_residuals import (
    GroupedResiduals,
    grouped_residuals,
    groups_on,
)
from registration.rigid.residual_model.likelihood import fit_residuals

GRID = [Ratios(20.0, size, border, 0.0) for size in (0.0, 4.0, 100.0, 2500.0) for border in (0.3, 10.0)]


def drawn(ratios: Ratios, noise_mm: float, seed: int) -> GroupedResiduals:
    """Residuals drawn from the model, with a motion of half a millimetre in every direction."""
    root = np.linalg.cholesky(PARTS(ratios))
    normal = np.random.default_rng(seed).standard_normal(len(root))
    return replace(BARE, gap_mm=noise_mm * root @ normal + BARE.jacobian @ np.full(7, 0.5))


def test_the_matern_function_has_the_values_of_its_formula() -> None:
    assert matern(np.array([0.0, 10.0]), 10.0) == pytest.approx([1.0, 0.52399], abs=1e-5)


def test_the_parts_of_the_covariance_follow_the_normals_and_the_frames() -> None:
    """Tissue that moves by a millimetre moves two walls that face each other by as much, one of them inwards."""
    facing = GroupedResiduals(
        np.zeros(3), 1.0, np.array([[3.0, 0, 0], [-3.0, 0, 0]]), np.array([[1.0, 0, 0], [-1.0, 0, 0]]),
        np.zeros(2), np.zeros((2, 6)), np.array([[1.0, 1.0], [1.0, 1.0]]), 1.0, 0.1, 10.0,
    )  # fmt: skip
    parts = CovarianceParts(facing)
    moved = parts(Ratios(1e6, 4.0, 0.0, 0.0))
    np.testing.assert_allclose(moved, [[5, -4], [-4, 5]], atol=1e-6)
    np.testing.assert_allclose(parts(Ratios(15.0, 0.0, 0.0, 2.0)), [[3, -2], [-2, 3]])
    border = parts(Ratios(15.0, 0.0, 2.0, 0.0))
    assert border[0, 0] == 3
    assert border[0, 1] == pytest.approx(np.exp(-0.5 * 36 / 16) + np.exp(-0.5 * 36 / 144))


def test_the_restricted_likelihood_is_the_density_of_what_no_motion_explains() -> None:
    residuals = drawn(GRID[4], 0.1, 0)
    fits = fit_residuals(residuals, PARTS, GRID)
    contrasts = null_space(residuals.jacobian.T)
    density = [
        multivariate_normal(cov=noise_mm2 * contrasts.T @ PARTS(ratios) @ contrasts).logpdf(
            contrasts.T @ residuals.gap_mm
        )
        for ratios, noise_mm2 in zip(GRID, fits.noise_mm2, strict=True)
    ]
    np.testing.assert_allclose(np.diff(fits.log_likelihood), np.diff(density), atol=0.02)


def test_motion_and_spread_are_those_of_generalised_least_squares() -> None:
    residuals = drawn(GRID[4], 0.1, 1)
    fits = fit_residuals(residuals, PARTS, GRID[4:5])
    inverse = np.linalg.inv(PARTS(GRID[4]))
    spread = np.linalg.inv(residuals.jacobian.T @ inverse @ residuals.jacobian)
    np.testing.assert_allclose(fits.spread[0], spread, rtol=1e-3, atol=1e-6)
    expected = spread @ residuals.jacobian.T @ inverse @ residuals.gap_mm
    np.testing.assert_allclose(fits.motion_mm[0], expected, atol=1e-3)


@pytest.mark.parametrize("seed", range(3))
def test_a_displacement_that_was_put_in_is_found_with_its_size_and_none_where_there_is_none(
    seed: int,
) -> None:
    bent = fit_residuals(drawn(Ratios(20.0, 100.0, 0.3, 0.0), 0.1, seed), PARTS, GRID)
    assert bent.ratios[bent.best].displacement == 100
    assert bent.noise_mm2[bent.best] == pytest.approx(0.01, rel=0.4)
    assert bent.gain > 20
    still = fit_residuals(drawn(Ratios(20.0, 0.0, 0.3, 0.0), 0.1, seed), PARTS, GRID)
    assert still.gain < 3
    assert still.weights.sum() == pytest.approx(1)
    assert len(bent.chosen(0.1).ratios) < len(GRID)


def test_a_small_motion_of_the_cloud_is_read_from_its_residuals() -> None:
    true_mm = np.array([0.2, -0.1, 0.3, 0.3, -0.2, 0.1])
    moved = TARGET.points_mm[::2]
    away = transforms.apply(np.linalg.inv(BARE.motions(true_mm[None])[0]), moved)
    block = groups_on(away, TARGET, np.eye(4), 128)
    found = grouped_residuals(away, TARGET, np.eye(4), block=block, offset=False)
    fit = fit_residuals(found, CovarianceParts(found), [Ratios(20.0, 0.0, 0.0, 0.0)])
    back = transforms.apply(found.motions(fit.motion_mm)[0], away)
    assert np.sqrt(((back - moved) ** 2).sum(axis=1).mean()) < 0.1
    assert found.share > 0.99


def test_points_far_from_the_surface_are_left_out_and_frames_are_counted() -> None:
    points = POINTS_MM.copy()
    points[:240] += 40.0
    block = groups_on(points, TARGET, np.eye(4), 128)
    frame = np.arange(len(points)) % 7
    found = grouped_residuals(points, TARGET, np.eye(4), block=block, offset=True, frame=frame)
    assert found.share == pytest.approx(0.9, abs=0.02)
    assert np.abs(found.gap_mm).max() < 1
    assert found.shared_frames is not None
    assert 1 / 7 < np.diag(found.shared_frames).mean() < 1 / 3
