"""The order in which an epoch takes its training images, and how often it takes those without a vessel."""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Generator, Tensor
from torch.utils.data import Sampler


class EmptyFrameSampler(Sampler[int]):
    """Every image with a vessel once and the images without one ``weight`` times, in random order.

    Where ``weight`` is no whole number, the images that are drawn once more are chosen anew in each epoch, so that
    none is left out for good and every epoch has the same length.

    Parameters
    ----------
    has_vessel : Tensor of bool, shape (n,)
        Whether each image shows a vessel.
    weight : float
        How often an image without one is drawn in an epoch, from 0.
    generator : Generator
        Random numbers, seeded before each epoch.
    """

    def __init__(self, has_vessel: Tensor, weight: float, generator: Generator) -> None:
        self.generator = generator
        self._shown = has_vessel.nonzero().flatten()
        self._empty = (~has_vessel).nonzero().flatten()
        self._draws = round(weight * len(self._empty))

    def __len__(self) -> int:
        return len(self._shown) + self._draws

    def __iter__(self) -> Iterator[int]:
        order = self._shown
        if self._draws:
            times = -(-self._draws // len(self._empty))
            shuffled = [self._empty[self._permutation(len(self._empty))] for _ in range(times)]
            order = torch.cat([order, torch.cat(shuffled)[: self._draws]])
        yield from order[self._permutation(len(order))].tolist()

    def _permutation(self, count: int) -> Tensor:
        return torch.randperm(count, generator=self.generator)
