"""Displacements of tissue drawn from the model and found again: where it was swept, and how surely elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tube_residuals import BARE, PARTS, TUBE

from registration.rigid.residual_model.covariance import Ratios, matern
from registration.rigid.residual_model.likelihood import fit_residuals
from registration.rigid.residual_model.posterior import Posterior, unseen

RATIOS = Ratios(20.0, 400.0, 0.0, 0.0)
NOISE_MM = 0.05
SWEPT_MM = BARE.points_mm[::8]
FAR_MM = TUBE.vertices_mm[:4] + 500.0


def field(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Displacement at the groups and at the swept points, drawn together: variance 1 per coordinate."""
    points = np.concatenate([BARE.points_mm, SWEPT_MM])
    away = np.linalg.norm(points[:, None] - points[None], axis=2)
    root = np.linalg.cholesky(matern(away, 20.0) + 1e-8 * np.eye(len(points)))
    drawn = root @ np.random.default_rng(seed).standard_normal((len(points), 3))
    return drawn[: len(BARE.points_mm)], drawn[len(BARE.points_mm) :]


def posterior_of(seed: int) -> tuple[Posterior, np.ndarray]:
    at_groups, at_swept = field(seed)
    noise = NOISE_MM * np.random.default_rng([seed, 1]).standard_normal(len(at_groups))
    residuals = replace(BARE, gap_mm=(at_groups * BARE.normals).sum(axis=1) + noise)
    return Posterior(residuals, fit_residuals(residuals, PARTS, [RATIOS])), at_swept


def test_a_displacement_is_found_again_where_it_was_swept() -> None:
    errors = []
    for seed in range(4):
        posterior, true_mm = posterior_of(seed)
        errors.append(posterior.mean_mm(SWEPT_MM) - true_mm)
        assert posterior.bent_mm() == pytest.approx(1.0, abs=0.8)
    # What lies along the wall shows only where the wall turns.
    assert np.sqrt((np.array(errors) ** 2).sum(axis=2).mean()) < 0.9
    assert np.sqrt((np.array([field(seed)[1] for seed in range(4)]) ** 2).sum(axis=2).mean()) > 1.3


def test_drawn_errors_are_as_large_as_the_true_ones() -> None:
    ranks = []
    for seed in range(24):
        posterior, true_mm = posterior_of(seed)
        motion_mm = posterior.rigid_part_mm(SWEPT_MM)
        drawn = posterior.errors_mm(SWEPT_MM, motion_mm, 200, np.random.default_rng(seed))
        moved = (posterior.moved(SWEPT_MM) @ motion_mm).reshape(-1, 3)
        true = np.sqrt(((true_mm - moved) ** 2).sum(axis=1).mean())
        ranks.append((np.sqrt((drawn**2).sum(axis=2).mean(axis=1)) < true).mean())
    assert 0.35 < np.mean(ranks) < 0.65
    assert np.mean((np.array(ranks) > 0.05) & (np.array(ranks) < 0.95)) > 0.75


def test_where_nothing_was_swept_the_displacement_is_as_free_as_before() -> None:
    posterior, _ = posterior_of(0)
    still = posterior.errors_mm(FAR_MM, posterior.fits.motion_mm[0, :6], 400, np.random.default_rng(0))
    carried = posterior.moved(FAR_MM) @ posterior.fits.spread[0][:6, :6] @ posterior.moved(FAR_MM).T
    expected = np.sqrt(1.0 + posterior.fits.noise_mm2[0] * np.diag(carried).mean() - 0.0)
    assert still.std() == pytest.approx(expected, rel=0.35)
    doubled = posterior.errors_mm(FAR_MM, np.zeros(6), 400, np.random.default_rng(0), inflation=2.0)
    assert doubled.std(axis=0).mean() == pytest.approx(2 * still.std(axis=0).mean(), rel=0.2)


def test_an_unseen_motion_has_its_size_and_no_mean() -> None:
    posterior, _ = posterior_of(1)
    free = unseen(posterior.residuals, posterior.fits, 2.0, 45.0)
    assert free.fits.ratios[0].displacement * free.fits.noise_mm2[0] == pytest.approx(4.0)
    np.testing.assert_allclose(free.mean_mm(SWEPT_MM), 0.0, atol=1e-9)
    at_swept = free.errors_mm(SWEPT_MM, np.zeros(6), 200, np.random.default_rng(0))
    at_far = free.errors_mm(FAR_MM, np.zeros(6), 200, np.random.default_rng(0))
    assert at_swept.std() < at_far.std()
