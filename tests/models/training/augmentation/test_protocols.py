import pytest
import torch

from models.training.augmentation import RandomDraws
from models.training.augmentation.protocols import random_factor


def draws(count: int) -> RandomDraws:
    return RandomDraws(count, torch.device("cpu"), torch.Generator().manual_seed(0))


def test_draws_have_the_shape_and_the_range_they_say() -> None:
    signed, normal, chosen = draws(500).signed(3, 2), draws(500).normal(3, 2), draws(2000).chosen(0.2, 1)
    assert signed.shape == normal.shape == (500, 3, 2) and chosen.shape == (2000, 1)
    assert -1 <= float(signed.min()) < -0.98 and 0.98 < float(signed.max()) < 1
    assert float(normal.std()) == pytest.approx(1, rel=0.05) and float(normal.abs().max()) > 2
    assert set(chosen.unique().tolist()) == {0.0, 1.0} and 0.16 < float(chosen.mean()) < 0.24


def test_never_and_always_are_exact() -> None:
    assert not draws(1000).chosen(0.0).any() and draws(1000).chosen(1.0).all()


def test_factors_are_symmetric_about_one() -> None:
    factors = random_factor(0.5, torch.tensor([-1.0, 0.0, 1.0]))
    torch.testing.assert_close(factors, torch.tensor([1 / 1.5, 1.0, 1.5]))
