"""Repair of averaged networks: the variance that hidden channels lose in the average is restored."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import torch
from torch import Tensor, nn

from models.averaging.batch_statistics import (
    PooledStatistics,
    batch_normalisations,
    reestimate_batch_statistics,
)
from models.errors import InputError
from models.weights import Weights

# Added to variances before the square root, as in a normalisation layer.
EPSILON = 1e-5

Convolution = nn.Conv2d | nn.ConvTranspose2d
Batches = Callable[[], Iterable[Tensor]]


@torch.no_grad()
def repair(
    network: nn.Module, average: Weights, members: Sequence[Weights], batches: Batches
) -> dict[str, Tensor]:
    """Give an average of aligned networks the channel statistics of its members.

    Parameters
    ----------
    network : Module
        A network of the architecture; used to compute and left with the repaired weights, in evaluation mode.
    average : Weights
        State dict of the average.
    members : sequence of Weights
        State dicts of the networks in it, aligned as they were averaged.
    batches : callable
        Returns the images (b, 1, h, w), the same at every call.

    Returns
    -------
    dict of str to Tensor
        The repaired state dict.

    Raises
    ------
    InputError
        If there are no members or no images.

    Notes
    -----
    With batch normalisation that is the same as to re-estimate its statistics. Without, every hidden
    convolution that has a bias is scaled and shifted, channel by channel, so that its outputs have the mean
    of the members' means and the mean of their standard deviations; in one pass, in which channels are
    already corrected by the batch's own statistics on their way to the next layer.

    References
    ----------
    K. Jordan et al., ICLR 2023.
    """
    if not members:
        raise InputError("members: expected the networks of the average, received none")
    if batch_normalisations(network):
        network.load_state_dict(dict(average))
        reestimate_batch_statistics(network, batches())
    else:
        goals = _goals(network, members, batches)
        network.load_state_dict(dict(average))
        found = _statistics(network, batches(), goals)
        for layer, (mean, deviation) in goals.items():
            _rescale(layer, found[layer], mean, deviation)
    return {name: tensor.detach().clone() for name, tensor in network.eval().state_dict().items()}


def _hidden_convolutions(network: nn.Module) -> list[Convolution]:
    # A single output channel is a logit or a gate, whose scale matters.
    return [
        module
        for module in network.modules()
        if isinstance(module, (nn.Conv2d, nn.ConvTranspose2d))
        and module.bias is not None
        and module.out_channels > 1
    ]


Goals = dict[Any, tuple[Tensor, Tensor]]


def _goals(network: nn.Module, members: Sequence[Weights], batches: Batches) -> Goals:
    """By layer the means and standard deviations, averaged over the members."""
    sums: Goals = {}
    for weights in members:
        network.load_state_dict(dict(weights))
        for layer, statistics in _statistics(network, batches(), {}).items():
            mean, deviation = statistics.mean, statistics.variance(correction=0).sqrt()
            before = sums.get(layer, (torch.zeros_like(mean), torch.zeros_like(deviation)))
            sums[layer] = (before[0] + mean / len(members), before[1] + deviation / len(members))
    return sums


def _statistics(network: nn.Module, batches: Iterable[Tensor], goals: Goals) -> dict[Any, PooledStatistics]:
    """By layer the statistics of its outputs, before they are corrected to the goals there are."""
    network.eval()
    seen = 0
    with _observed_and_corrected(_hidden_convolutions(network), goals) as pooled:
        for batch in batches:
            network(batch)
            seen += len(batch)
    if not seen:
        raise InputError("batches: expected at least one batch of images, received none")
    return pooled


@contextmanager
def _observed_and_corrected(layers: list[Convolution], goals: Goals) -> Iterator[dict[Any, PooledStatistics]]:
    pooled: dict[Any, PooledStatistics] = {layer: PooledStatistics() for layer in layers}

    def observe(layer: nn.Module, received: tuple[Tensor, ...], result: Tensor) -> Tensor | None:
        pooled[layer].update(result)
        if layer not in goals:
            return None
        mean, deviation = (each.to(result).reshape(1, -1, 1, 1) for each in goals[layer])
        variance, batch_mean = torch.var_mean(result, dim=(0, 2, 3), correction=0, keepdim=True)
        return (result - batch_mean) * (deviation / (variance + EPSILON).sqrt()) + mean

    handles = [layer.register_forward_hook(observe) for layer in layers]
    try:
        yield pooled
    finally:
        for handle in handles:
            handle.remove()


def _rescale(layer: Convolution, found: PooledStatistics, mean: Tensor, deviation: Tensor) -> None:
    """Scale and shift a layer's outputs from the statistics found to the goal, by its weight and bias."""
    scale = deviation / (found.variance(correction=0) + EPSILON).sqrt()
    assert layer.bias is not None
    axis = 0 if isinstance(layer, nn.Conv2d) else 1
    shape = [1] * layer.weight.ndim
    shape[axis] = -1
    layer.weight.mul_(scale.reshape(shape).to(layer.weight))
    layer.bias.copy_(((layer.bias.cpu().double() - found.mean) * scale + mean).to(layer.bias))
