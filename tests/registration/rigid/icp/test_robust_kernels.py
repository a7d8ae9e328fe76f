"""Weights of the kernels at points known by their definition."""

from __future__ import annotations

import numpy as np
import pytest

from registration.errors import InputError
from registration.rigid.icp.robust_kernels import Huber, Tukey, Welsch, robust_scale

AT = np.array([0.0, 1.0, -2.0, 4.0])


def test_weights_by_definition() -> None:
    np.testing.assert_allclose(Huber(2.0)(AT), [1, 1, 1, 0.5])
    np.testing.assert_allclose(Tukey(4.0)(AT), [1, (15 / 16) ** 2, (3 / 4) ** 2, 0])
    np.testing.assert_allclose(Tukey(4.0)(np.array([9.0])), [0])
    np.testing.assert_allclose(Welsch(2.0)(AT), np.exp([0, -0.25, -1, -4]))


@pytest.mark.parametrize("kernel", [Huber(), Tukey(), Welsch()])
def test_the_usual_tuning_is_95_percent_efficient_on_normal_residuals(kernel: Huber | Tukey | Welsch) -> None:
    """The asymptotic variance of the location it estimates is 1 / 0.95 (Holland and Welsch, 1977)."""
    at = np.linspace(-8, 8, 40001)
    density = np.exp(-(at**2) / 2) / np.sqrt(2 * np.pi)
    influence = at * kernel(at)
    slope = np.gradient(influence, at)
    efficiency = np.trapezoid(slope * density, at) ** 2 / np.trapezoid(influence**2 * density, at)
    assert efficiency == pytest.approx(0.95, abs=0.002)


def test_the_robust_scale_is_a_standard_deviation_that_outliers_do_not_move() -> None:
    residuals = 0.3 * np.random.default_rng(0).standard_normal((2, 20_000))
    residuals[1, :2000] = 50.0
    size = robust_scale(residuals, 1e-9)
    assert size.shape == (2, 1)
    assert size[0, 0] == pytest.approx(0.3, rel=0.03)
    assert size[1, 0] == pytest.approx(0.3, rel=0.2)
    np.testing.assert_allclose(robust_scale(np.zeros((1, 5)), 0.01), 0.01)


@pytest.mark.parametrize("kernel", [Huber, Tukey, Welsch])
def test_a_tuning_must_be_positive(kernel: type) -> None:
    with pytest.raises(InputError, match="tuning: expected"):
        kernel(0.0)
