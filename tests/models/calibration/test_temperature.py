import math
from collections.abc import Iterator

import numpy as np
import pytest
import torch
from sklearn.linear_model import LogisticRegression

from models.calibration import TemperatureScaling, fit_temperature, logits_of
from models.errors import InputError


def drawn(n: int, temperature: float, bias: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Logits of a network, and labels drawn as if the truth were ``sigmoid(logit / temperature + bias)``."""
    generator = np.random.default_rng(seed)
    logits = generator.normal(-1, 3, n).astype(np.float32)
    truth = 1 / (1 + np.exp(-(logits / temperature + bias)))
    return logits, generator.random(n) < truth


def test_scaling_by_hand() -> None:
    logits = np.array([[0.0, 2.0], [-2.0, 4.0]], np.float32)
    expected = [[0.5, 1 / (1 + math.exp(-1))], [1 / (1 + math.exp(1)), 1 / (1 + math.exp(-2))]]
    np.testing.assert_allclose(TemperatureScaling(2.0)(logits), expected, rtol=1e-6)
    assert float(TemperatureScaling(2.0, -1.0)(logits)[0, 1]) == pytest.approx(0.5)
    np.testing.assert_allclose(
        TemperatureScaling()(logits), torch.sigmoid(torch.from_numpy(logits)).numpy(), rtol=1e-7
    )


@pytest.mark.parametrize("temperature", [1e-3, 0.3, 1.0, 7.0, 1e4])
def test_no_temperature_changes_the_mask_at_a_half(temperature: float) -> None:
    generator = np.random.default_rng(0)
    logits = np.concatenate([generator.normal(0, 5, 5000), [0.0, 1e-12, -1e-12, 1e-30, -1e-30, 80.0, -80.0]])
    logits = logits.astype(np.float32)
    np.testing.assert_array_equal(TemperatureScaling(temperature)(logits) >= 0.5, logits >= 0)


def test_the_fit_finds_the_temperature_that_the_labels_were_drawn_with() -> None:
    logits, labels = drawn(200_000, 2.5, 0.0)
    found = fit_temperature(lambda: [(logits, labels)])
    assert found.scaling.temperature == pytest.approx(2.5, rel=0.02) and found.scaling.bias == 0
    assert found.nll_after < found.nll_before and found.pixels == 200_000


def test_the_fit_equals_logistic_regression() -> None:
    logits, labels = drawn(20_000, 1.7, -0.8)
    found = fit_temperature(lambda: [(logits, labels)], with_bias=True)
    peer = LogisticRegression(C=np.inf, tol=1e-10).fit(logits[:, None].astype(np.float64), labels)
    assert 1 / found.scaling.temperature == pytest.approx(float(peer.coef_[0, 0]), rel=1e-5)
    assert found.scaling.bias == pytest.approx(float(peer.intercept_[0]), rel=1e-4)
    without = fit_temperature(lambda: [(logits, labels)])
    assert found.nll_after < without.nll_after
    peer = LogisticRegression(C=np.inf, tol=1e-10, fit_intercept=False).fit(
        logits[:, None].astype(float), labels
    )
    assert 1 / without.scaling.temperature == pytest.approx(float(peer.coef_[0, 0]), rel=1e-5)


def test_neither_order_nor_size_of_the_batches_counts_and_the_data_are_streamed() -> None:
    logits, labels = drawn(6000, 0.6, 0.4)
    alive: list[int] = []

    def parts(sizes: list[int]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        begin = 0
        for size in sizes:
            alive.append(size)
            yield logits[begin : begin + size].reshape(-1, 10), labels[begin : begin + size].reshape(-1, 10)
            begin += size

    whole = fit_temperature(lambda: parts([6000]), with_bias=True)
    parted = fit_temperature(lambda: parts([100, 5000, 900]), with_bias=True)
    assert parted.scaling.temperature == pytest.approx(whole.scaling.temperature, rel=1e-9)
    assert parted.scaling.bias == pytest.approx(whole.scaling.bias, rel=1e-9)
    assert len(alive) == whole.passes + 3 * parted.passes


def test_the_gradient_vanishes_at_the_fit() -> None:
    logits, labels = drawn(5000, 3.0, 1.0)
    found = fit_temperature(lambda: [(logits, labels)], with_bias=True)
    excess = found.scaling(logits).astype(np.float64) - labels
    assert abs(excess.mean()) < 1e-6 and abs((excess * logits).mean()) < 1e-5


def test_the_threshold_before_calibration() -> None:
    scaling = TemperatureScaling(2.0, 0.5)
    before = scaling.threshold_before(0.3)
    assert float(scaling(logits_of(np.array([before])))[0]) == pytest.approx(0.3, rel=1e-5)
    assert TemperatureScaling(3.0).threshold_before(0.5) == 0.5


def test_logits_of_probabilities_and_back() -> None:
    probability = np.array([0.0, 1e-6, 0.2, 0.5, 0.999, 1.0], np.float32)
    back = 1 / (1 + np.exp(-logits_of(probability).astype(np.float64)))
    np.testing.assert_allclose(back, probability, atol=1e-7)
    assert np.isfinite(logits_of(probability)).all()


def test_refuses_what_has_no_fit() -> None:
    logits, labels = drawn(100, 1.0, 0.0)
    with pytest.raises(InputError, match="separated perfectly"):
        fit_temperature(lambda: [(logits, logits > 0)])
    # With a bias, any threshold separates; without, that at 0 alone.
    with pytest.raises(InputError, match="separated perfectly"):
        fit_temperature(lambda: [(logits, logits > 1)], with_bias=True)
    assert fit_temperature(lambda: [(logits, logits > 1)]).scaling.temperature > 1e-3
    with pytest.raises(InputError, match="found it rising beyond 1000"):
        fit_temperature(lambda: [(logits, logits < 0)])
    with pytest.raises(InputError, match="found 0 of 100 of vessel"):
        fit_temperature(lambda: [(logits, np.zeros(100, bool))])
    with pytest.raises(InputError, match="batches: expected logits and masks, received none"):
        fit_temperature(lambda: [])
    once = iter([(logits, labels)])
    with pytest.raises(InputError, match="batches: expected"):
        fit_temperature(lambda: once)
    with pytest.raises(InputError, match=r"masks: expected the logits' shape \(100,\), received \(99,\)"):
        fit_temperature(lambda: [(logits, labels[:-1])])
    with pytest.raises(InputError, match="masks: expected 0 and 1"):
        fit_temperature(lambda: [(logits, 2 * labels)])
    with pytest.raises(InputError, match="logits: expected finite"):
        fit_temperature(lambda: [(np.full(2, np.nan, np.float32), np.array([0, 1]))])
    with pytest.raises(InputError, match="max_iter: expected enough"):
        fit_temperature(lambda: [drawn(5000, 3.0, 1.0)], with_bias=True, max_iter=1)


def test_refuses_scalings_that_are_none() -> None:
    for temperature in (0.0, -1.0, math.inf, math.nan):
        with pytest.raises(InputError, match="temperature: expected a positive number"):
            TemperatureScaling(temperature)
    with pytest.raises(InputError, match="bias: expected a finite number"):
        TemperatureScaling(1.0, math.nan)
    with pytest.raises(InputError, match="threshold: expected above 0 and below 1"):
        TemperatureScaling().threshold_before(1.0)
