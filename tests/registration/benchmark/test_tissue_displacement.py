"""Displacements of other forms than the simulator's: their size, their reach, their covariance, and no folding."""

from __future__ import annotations

import numpy as np
import pytest

from registration.benchmark.tissue_displacement import (
    FIELD_LENGTH_MM,
    Indentation,
    RandomField,
    draw_field,
    draw_indentation,
)
from registration.geometry.rigid_fit import kabsch
from registration.phantom.displacement import BODY_MM

GUIDE_MM = np.column_stack(
    [3 * np.sin(np.linspace(0, 3, 40)), np.linspace(-2, 4, 40), np.linspace(-40, 40, 40)]
)


def jacobians(displacement: Indentation | RandomField, points_mm: np.ndarray) -> np.ndarray:
    step = 1e-4
    columns = [
        (displacement(points_mm + step * axis) - displacement(points_mm - step * axis)) / (2 * step)
        for axis in np.eye(3)
    ]
    return np.stack(columns, axis=2)


def test_a_dent_is_deepest_at_its_centre_and_ends_at_its_reach() -> None:
    dent = Indentation(np.array([1.0, 2.0, 3.0]), np.array([0.0, 2.0, 0.0]), 10.0)
    places = np.array([[1.0, 2.0, 3.0], [1.0, 2.0, 8.0], [11.0, 2.0, 3.0], [1.0, 2.0, 40.0]])
    # Wendland's function at half its reach: (1/2)^4 (4/2 + 1).
    np.testing.assert_allclose(
        dent(places) - places, [[0, 2, 0], [0, 2 * 3 / 16, 0], [0, 0, 0], [0, 0, 0]], atol=1e-12
    )
    assert dent(places.astype(np.float32)).dtype == np.float32


def test_a_drawn_dent_lies_beside_the_vessel_and_pushes_towards_it() -> None:
    for seed in range(20):
        dent = draw_indentation(GUIDE_MM, 4.0, np.random.default_rng(seed))
        assert np.linalg.norm(dent.push_mm) == pytest.approx(4.0)
        nearest_mm = GUIDE_MM[np.linalg.norm(GUIDE_MM - dent.centre_mm, axis=1).argmin()]
        assert (nearest_mm - dent.centre_mm) @ dent.push_mm > 0


def test_a_field_moves_the_vessel_by_its_size_once_its_rigid_part_is_out() -> None:
    field = draw_field(GUIDE_MM, 4.0, np.random.default_rng(3))
    moved_mm = field(GUIDE_MM)
    assert np.linalg.norm(moved_mm - GUIDE_MM, axis=1).max() == pytest.approx(4.0, abs=0.01)
    # A line leaves its roll open: the rigid part is that of the tissue around it too.
    aside_mm = np.concatenate([np.zeros((1, 3)), np.eye(3)[:2], -np.eye(3)[:2]]) * BODY_MM
    body_mm = (GUIDE_MM[:, None] + aside_mm).reshape(-1, 3)
    np.testing.assert_allclose(kabsch(field(body_mm), body_mm), np.eye(4), atol=1e-9)
    assert field(GUIDE_MM.astype(np.float32)).dtype == np.float32


def test_waves_have_the_spectrum_of_materns_covariance() -> None:
    waves = np.concatenate(
        [draw_field(GUIDE_MM, 2.0, np.random.default_rng(seed)).waves for seed in range(300)]
    )
    for apart_mm in (5.0, 15.0, 40.0):
        scaled = np.sqrt(3) * apart_mm / FIELD_LENGTH_MM
        assert np.cos(apart_mm * waves).mean() == pytest.approx((1 + scaled) * np.exp(-scaled), abs=0.02)


@pytest.mark.parametrize("seed", range(4))
def test_the_largest_of_them_do_not_fold_the_tissue(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points_mm = np.repeat(GUIDE_MM, 20, axis=0) + rng.uniform(-12, 12, (20 * len(GUIDE_MM), 3))
    for displacement in (draw_indentation(GUIDE_MM, 4.0, rng), draw_field(GUIDE_MM, 4.0, rng)):
        assert np.linalg.det(jacobians(displacement, points_mm)).min() > 0.2
