"""The order in which an epoch takes its training images, and how often it takes those without a vessel."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Generator, Tensor
from torch.utils.data import Sampler


@dataclass(frozen=True)
class Share:
    """Which part of each training batch one of several processes takes.

    Parameters
    ----------
    number : int, optional
        Number of the process, from 0.
    processes : int, optional
        Number of processes that share a batch.
    """

    number: int = 0
    processes: int = 1

    def of(self, count: int) -> tuple[slice, float]:
        """Divide a batch so that the mean over processes of weighted mean losses is the mean over all images.

        Parameters
        ----------
        count : int
            Number of images in the batch, from 1.

        Returns
        -------
        part : slice
            The process's images. Where there are fewer images than processes, one that has none takes the first.
        weight : float
            Weight of its mean loss; 0 for a process that has no image of its own.
        """
        begin = self.number * count // self.processes
        end = (self.number + 1) * count // self.processes
        if begin == end:
            return slice(0, 1), 0.0
        return slice(begin, end), (end - begin) * self.processes / count


WHOLE = Share()


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
