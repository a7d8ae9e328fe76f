"""Re-estimation of batch normalisation statistics for weights that were never trained, such as an average."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

import torch
from torch import Tensor, nn
from torch.nn.modules.batchnorm import _BatchNorm
from torch.nn.modules.instancenorm import _InstanceNorm

from models.array_types import Float, Float64
from models.errors import InputError


class PooledStatistics:
    """Mean and variance of every channel over all batches, in 64 bits and the memory of one batch.

    Batches are merged by the formula of Chan, Golub and LeVeque (1979), so that neither their order nor their
    sizes matter but for rounding.
    """

    def __init__(self) -> None:
        self.count = 0
        self.mean = torch.zeros(0, dtype=torch.float64)
        self._squares = torch.zeros(0, dtype=torch.float64)

    def update(self, features: Float[Tensor, "b c *space"]) -> None:
        """Add the features of a batch.

        Parameters
        ----------
        features : Tensor, shape (b, c, ...)
            Features with channels on the second axis.
        """
        others = [axis for axis in range(features.ndim) if axis != 1]
        count = features.numel() // features.shape[1]
        variance, mean = torch.var_mean(features.detach().float(), dim=others, correction=0)
        variance, mean = variance.cpu().double(), mean.cpu().double()
        if not self.count:
            self.count, self.mean, self._squares = count, mean, variance * count
            return
        total = self.count + count
        apart = mean - self.mean
        self._squares = self._squares + variance * count + apart**2 * (self.count * count / total)
        self.mean = self.mean + apart * (count / total)
        self.count = total

    def variance(self, correction: int) -> Float64[Tensor, " c"]:
        """Compute the variance of every channel.

        Parameters
        ----------
        correction : int
            Subtracted from the count in the denominator; 1 for the unbiased variance.

        Returns
        -------
        Tensor, shape (c,)
            Variances in 64 bits.
        """
        return self._squares / (self.count - correction)


@torch.no_grad()
def reestimate_batch_statistics(network: nn.Module, batches: Iterable[Tensor]) -> int:
    """Set the statistics of all batch normalisations to those over batches, in one pass and constant memory.

    Parameters
    ----------
    network : Module
        Its buffers are changed in place, its modes are not.
    batches : iterable of Tensor, shape (b, 1, h, w)
        Images as the network takes them, on its device.

    Returns
    -------
    int
        Number of images read.

    Raises
    ------
    InputError
        If there is no batch, or an instance normalisation tracks statistics (no network of ours does).

    Notes
    -----
    In the pass, layers normalise by the statistics of each batch, as in training; dropout is off, as in
    inference. Mean and variance are those over all values of all batches, each value with the same weight;
    the variance is unbiased, as in torch. A network without batch normalisation is left as it is, and no
    batch is read.

    References
    ----------
    P. Izmailov et al., UAI 2018; K. Jordan et al., ICLR 2023 (after averaging).
    """
    layers = batch_normalisations(network)
    if not layers:
        return 0
    images, n_batches = 0, 0
    with _normalising_by_batch(network, layers), _observed(layers) as pooled:
        for batch in batches:
            network(batch)
            images, n_batches = images + len(batch), n_batches + 1
    if not images:
        raise InputError("batches: expected at least one batch of images, received none")
    for layer in layers:
        statistics = pooled[layer]
        assert layer.running_mean is not None and layer.running_var is not None
        layer.running_mean.copy_(statistics.mean)
        layer.running_var.copy_(statistics.variance(correction=1))
        if layer.num_batches_tracked is not None:
            layer.num_batches_tracked.fill_(n_batches)
    return images


def batch_normalisations(network: nn.Module) -> list[_BatchNorm]:
    """Find the layers whose statistics are fixed in inference.

    Parameters
    ----------
    network : Module
        Any network.

    Returns
    -------
    list of Module
        The batch normalisations that track statistics.

    Raises
    ------
    InputError
        If a layer has statistics that can't be re-estimated.
    """
    for name, module in network.named_modules():
        if isinstance(module, _InstanceNorm) and module.running_mean is not None:
            raise InputError(
                f"{name}: expected an instance normalisation without tracked statistics, found some"
            )
    return [
        module
        for module in network.modules()
        if isinstance(module, _BatchNorm) and module.running_mean is not None
    ]


@contextmanager
def _normalising_by_batch(network: nn.Module, layers: list[_BatchNorm]) -> Iterator[None]:
    """Normalisation as in training, all else as in use, and no layer that changes its own statistics."""
    modes = {module: module.training for module in network.modules()}
    network.eval()
    try:
        for layer in layers:
            layer.training, layer.track_running_stats = True, False
        yield
    finally:
        for layer in layers:
            layer.track_running_stats = True
        for module, mode in modes.items():
            module.training = mode


@contextmanager
def _observed(layers: list[_BatchNorm]) -> Iterator[dict[nn.Module, PooledStatistics]]:
    """The statistics of what every layer receives while the context is open."""
    pooled: dict[nn.Module, PooledStatistics] = {layer: PooledStatistics() for layer in layers}

    def observe(layer: nn.Module, received: tuple[Tensor, ...]) -> None:
        pooled[layer].update(received[0])

    handles = [layer.register_forward_pre_hook(observe) for layer in layers]
    try:
        yield pooled
    finally:
        for handle in handles:
            handle.remove()
