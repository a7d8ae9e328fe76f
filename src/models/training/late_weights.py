"""Weights that are validated and kept in the place of the latest ones: an average along the training.

An average exists only once steps of this training have entered it; until then the latest weights are validated.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from torch import Tensor, nn

from models.averaging.batch_statistics import reestimate_batch_statistics
from models.averaging.running import ExponentialAverage, RunningAverage, StochasticAverage
from models.training.settings import TrainerSettings


class LateWeights:
    """Running average of the weights of one training.

    ``ema`` is updated after each step, with a memory of ``settings.ema_epochs`` epochs; ``swa`` after each epoch of the
    last ``settings.swa_share`` of ``settings.max_epochs``, and of an extension.

    Parameters
    ----------
    settings : TrainerSettings
        Which average, and over what.
    steps_per_epoch : int
        Number of batches in an epoch.

    References
    ----------
    P. Izmailov et al., UAI 2018 (swa); A. Tarvainen and H. Valpola, NeurIPS 2017 (ema of weights).
    """

    def __init__(self, settings: TrainerSettings, steps_per_epoch: int) -> None:
        self.kind = settings.late_weights
        self.first_epoch = math.ceil(settings.max_epochs * (1 - settings.swa_share))
        self._average: RunningAverage | None = None
        if self.kind == "ema":
            self._average = ExponentialAverage(1 - 1 / max(1.0, settings.ema_epochs * steps_per_epoch))
        elif self.kind == "swa":
            self._average = StochasticAverage()

    def after_step(self, network: nn.Module) -> None:
        """Take the weights after a step of the optimiser.

        Parameters
        ----------
        network : nn.Module
            The network in training.
        """
        if self._average is not None and self.kind == "ema":
            self._average.update(network.state_dict())

    def after_epoch(self, network: nn.Module, epoch: int) -> None:
        """Take the weights after the last step of an epoch.

        Parameters
        ----------
        network : nn.Module
            The network in training.
        epoch : int
            Number of the epoch, counted from 0.
        """
        if self._average is not None and self.kind == "swa" and epoch >= self.first_epoch:
            self._average.update(network.state_dict())

    @contextmanager
    def in_place(self, network: nn.Module, images: Callable[[], Iterable[Tensor]]) -> Iterator[None]:
        """Put the average into a network, and the latest weights back afterwards.

        Parameters
        ----------
        network : nn.Module
            The network in training; left as it is as long as there is no average.
        images : callable
            Returns batches of training images, normalised and on the network's device, from which statistics of
            batch normalisations are estimated anew: those of the average were never measured.
        """
        if self._average is None or not self._average.updates:
            yield
            return
        latest = {name: tensor.detach().clone() for name, tensor in network.state_dict().items()}
        network.load_state_dict(self._average.weights)
        reestimate_batch_statistics(network, images())
        try:
            yield
        finally:
            network.load_state_dict(latest)

    def state(self) -> dict[str, Any]:
        """Return the state that ``restore`` continues from.

        Returns
        -------
        dict
            Tensors, text and numbers; empty where nothing is averaged.
        """
        return {} if self._average is None else self._average.state()

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from a state.

        Parameters
        ----------
        state : mapping
            Result of ``state``.
        """
        if self._average is not None:
            self._average.restore(state)
