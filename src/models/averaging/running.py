"""Averages of the weights along one training: exponential and stochastic weight averaging.

Both hold what ``update`` received after optimiser steps and nothing else: the weights that a training begins
from never enter, and there is no average before the first update.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from models.errors import InputError
from models.weights import Weights, require_alike


class RunningAverage(ABC):
    """Average of successive state dicts in the memory of one.

    Floating tensors are averaged, in 32 bits or more; of others the latest is kept.
    """

    def __init__(self) -> None:
        self.updates = 0
        self._average: dict[str, Tensor] = {}
        self._types: dict[str, torch.dtype] = {}

    @abstractmethod
    def newest_share(self, update: int) -> float:
        """Return the weight of the newest state dict in the average.

        Parameters
        ----------
        update : int
            Number of the update, from 1.

        Returns
        -------
        float
            Share of the newest weights, 0 to 1.
        """

    @torch.no_grad()
    def update(self, weights: Weights) -> None:
        """Add the weights after an optimiser step.

        Parameters
        ----------
        weights : Weights
            State dict.

        Raises
        ------
        InputError
            If names, shapes or types of the tensors differ from those of the update before.
        """
        received = {name: tensor.detach() for name, tensor in weights.items()}
        if not self.updates:
            self._types = {name: tensor.dtype for name, tensor in received.items()}
            self._average = {name: _copy(tensor) for name, tensor in received.items()}
        else:
            self._require_same_tensors(received)
            share = self.newest_share(self.updates + 1)
            for name, tensor in received.items():
                if tensor.is_floating_point():
                    self._average[name].lerp_(tensor.to(self._average[name]), share)
                else:
                    self._average[name].copy_(tensor)
        self.updates += 1

    @property
    def weights(self) -> dict[str, Tensor]:
        """State dict of the average; InputError before the first update or if a number is not finite."""
        if not self.updates:
            raise InputError("weights: expected an update after a step of the training, received none yet")
        average = {name: tensor.to(self._types[name], copy=True) for name, tensor in self._average.items()}
        require_alike({"the running average": average})
        return average

    def state(self) -> dict[str, Any]:
        """Return the state that ``restore`` continues from.

        Returns
        -------
        dict
            Tensors, text and numbers.
        """
        return {
            "updates": self.updates,
            "average": {name: tensor.clone() for name, tensor in self._average.items()},
            "types": {name: str(dtype).removeprefix("torch.") for name, dtype in self._types.items()},
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from a state.

        Parameters
        ----------
        state : mapping
            Result of ``state``.
        """
        self.updates = int(state["updates"])
        self._average = {name: tensor.clone() for name, tensor in state["average"].items()}
        self._types = {name: getattr(torch, dtype) for name, dtype in state["types"].items()}

    def _require_same_tensors(self, received: Weights) -> None:
        """Compares no values: this is done at every step."""
        for name in sorted(self._types.keys() | received.keys()):
            expected = (self._types.get(name), getattr(self._average.get(name), "shape", None))
            found = (getattr(received.get(name), "dtype", None), getattr(received.get(name), "shape", None))
            if expected != found:
                raise InputError(f"weights: expected {name} to be {expected} as before, received {found}")


class ExponentialAverage(RunningAverage):
    """Exponential moving average of weights (Polyak averaging with forgetting).

    ``average <- d average + (1 - d) weights`` with ``d = min(decay, (1 + n) / (10 + n))`` after ``n``
    updates: a constant decay near 1 would keep the first, hardly trained weights for 1 / (1 - decay) steps.

    Parameters
    ----------
    decay : float, optional
        From 0 to below 1; 0 keeps the latest weights.

    Raises
    ------
    InputError
        If ``decay`` is out of range.
    """

    def __init__(self, decay: float = 0.999) -> None:
        super().__init__()
        if not 0 <= decay < 1:
            raise InputError(f"decay: expected 0 to below 1, received {decay}")
        self.decay = decay

    def newest_share(self, update: int) -> float:
        """Return 1 minus the decay at an update.

        Parameters
        ----------
        update : int
            Number of the update, from 1.

        Returns
        -------
        float
            Share of the newest weights, 0 to 1.
        """
        before = update - 1
        return 1 - min(self.decay, (1 + before) / (10 + before))


class StochasticAverage(RunningAverage):
    """Stochastic weight averaging: the plain mean of all updates.

    Updates are made at the ends of epochs, late in a training. Statistics of batch normalisation have to be
    re-estimated afterwards.

    References
    ----------
    P. Izmailov et al., UAI 2018.
    """

    def newest_share(self, update: int) -> float:
        """Return the weight of one update in the mean of all.

        Parameters
        ----------
        update : int
            Number of the update, from 1.

        Returns
        -------
        float
            Share of the newest weights, 0 to 1.
        """
        return 1 / update


def _copy(tensor: Tensor) -> Tensor:
    if tensor.is_floating_point():
        return tensor.to(torch.promote_types(tensor.dtype, torch.float32), copy=True)
    return tensor.clone()
