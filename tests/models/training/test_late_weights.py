"""Averages along a training against means computed by hand, and the weights that the training goes on with."""

from __future__ import annotations

import dataclasses

import pytest
import torch
from torch import nn

from models.training.late_weights import LateWeights
from models.training.settings import TrainerSettings

SETTINGS = TrainerSettings(max_epochs=8, batch_size=2, learning_rate=0.5, patience=3)


def scalar(value: float) -> nn.Module:
    network = nn.Conv2d(1, 1, 1, bias=False)
    nn.init.constant_(network.weight, value)
    return network


def set_to(network: nn.Module, value: float) -> nn.Module:
    with torch.no_grad():
        network.weight.fill_(value)
    return network


def inside(late: LateWeights, network: nn.Module) -> float:
    with late.in_place(network, lambda: iter(())):
        return float(network.weight.detach())


@pytest.mark.parametrize("kind", ["none", "ema", "swa"])
def test_weights_that_no_step_has_changed_never_enter(kind: str) -> None:
    late = LateWeights(dataclasses.replace(SETTINGS, late_weights=kind), 4)
    network = scalar(7.0)
    assert inside(late, network) == 7.0
    late.after_step(set_to(network, 1.0))
    late.after_epoch(network, 7)
    assert inside(late, network) == 1.0


def test_swa_is_the_mean_of_the_last_quarter_of_the_epochs() -> None:
    late = LateWeights(dataclasses.replace(SETTINGS, late_weights="swa", swa_share=0.5), 4)
    network = scalar(0.0)
    for epoch, value in enumerate((10, 20, 30, 40, 1, 2, 6, 9)):
        set_to(network, value)
        late.after_step(network)
        late.after_epoch(network, epoch)
        if epoch < 4:
            assert inside(late, network) == value
    assert inside(late, network) == pytest.approx((1 + 2 + 6 + 9) / 4)
    assert float(network.weight) == 9.0


def test_ema_forgets_over_the_epochs_that_it_remembers() -> None:
    # Two epochs of two steps: a decay of 3/4, reached after the first updates.
    late = LateWeights(dataclasses.replace(SETTINGS, late_weights="ema", ema_epochs=2.0), 2)
    network, expected = scalar(0.0), None
    for step in range(60):
        late.after_step(set_to(network, float(step)))
        decay = min(0.75, (1 + step) / (10 + step))
        expected = float(step) if expected is None else decay * expected + (1 - decay) * step
    assert inside(late, network) == pytest.approx(expected, rel=1e-5)
    assert 59 - 4 < inside(late, network) < 59


def test_the_training_goes_on_with_its_own_weights_also_after_an_error() -> None:
    late = LateWeights(dataclasses.replace(SETTINGS, late_weights="ema"), 1)
    network = scalar(0.0)
    late.after_step(set_to(network, 1.0))
    late.after_step(set_to(network, 3.0))
    with pytest.raises(KeyError), late.in_place(network, lambda: iter(())):
        assert float(network.weight) < 3.0
        raise KeyError
    assert float(network.weight) == 3.0


def test_statistics_of_batch_normalisation_are_those_of_the_average() -> None:
    late = LateWeights(dataclasses.replace(SETTINGS, late_weights="swa", swa_share=1.0), 1)
    network = nn.Sequential(nn.Conv2d(1, 1, 1, bias=False), nn.BatchNorm2d(1))
    images = torch.arange(8.0).reshape(2, 1, 2, 2)
    for value in (1.0, 3.0):
        set_to(network[0], value)
        late.after_epoch(network, 0)
    running = network[1].running_mean.clone()
    with late.in_place(network, lambda: iter([images])):
        assert float(network[1].running_mean) == pytest.approx(2.0 * 3.5)
        assert float(network[1].running_var) == pytest.approx(4.0 * 6.0)
    assert torch.equal(network[1].running_mean, running)


@pytest.mark.parametrize("kind", ["ema", "swa"])
def test_an_average_is_resumed_exactly(kind: str) -> None:
    settings = dataclasses.replace(SETTINGS, late_weights=kind, swa_share=1.0)
    whole, network = LateWeights(settings, 3), scalar(0.0)
    values = [1.0, 4.0, 2.0, 8.0]
    for epoch, value in enumerate(values):
        set_to(network, value)
        whole.after_step(network)
        whole.after_epoch(network, epoch)
        if epoch == 1:
            halves = LateWeights(settings, 3)
            halves.restore(whole.state())
        elif epoch > 1:
            halves.after_step(network)
            halves.after_epoch(network, epoch)
    assert inside(halves, network) == inside(whole, network)
