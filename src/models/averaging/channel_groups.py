"""Groups of channels that must be permuted together, built up one tie after the other."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from models.errors import InputError

# The groups of channels that lie one after the other on an axis.
Layout = tuple[int, ...]


@dataclass
class ChannelGroups:
    """Groups of channels, some of which are united (a union-find forest).

    Parameters
    ----------
    sizes : list of int, optional
        Number of channels of each group.
    parents : list of int, optional
        Parent of each group in the forest; a root is its own.
    labels : list of list of ndarray, optional
        For each root, the restrictions of its channels.
    """

    sizes: list[int] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    labels: list[list[np.ndarray]] = field(default_factory=list)

    def new(self, size: int) -> int:
        """Add a group of channels without any tie.

        Parameters
        ----------
        size : int
            Number of channels.

        Returns
        -------
        int
            Number of the group.
        """
        self.sizes.append(size)
        self.parents.append(len(self.parents))
        self.labels.append([])
        return self.parents[-1]

    def root(self, group: int) -> int:
        """Find the group that represents a group and all united with it.

        Parameters
        ----------
        group : int
            Number of a group.

        Returns
        -------
        int
            Number of the representative.
        """
        while self.parents[group] != group:
            group = self.parents[group]
        return group

    def unite(self, first: Layout, second: Layout, where: str) -> None:
        """Tie two layouts: channels of equal place are permuted together.

        Parameters
        ----------
        first, second : tuple of int
            Groups that lie one after the other on an axis.
        where : str
            Operation that ties them, for the message.

        Raises
        ------
        InputError
            If the layouts are grouped differently.
        """
        if [self.sizes[group] for group in first] != [self.sizes[group] for group in second]:
            raise InputError(
                f"network: expected channels joined in {where} to be grouped alike, "
                f"found groups of {[self.sizes[g] for g in first]} and {[self.sizes[g] for g in second]}"
            )
        for one, other in zip(first, second, strict=True):
            low, high = sorted((self.root(one), self.root(other)))
            if low != high:
                self.parents[high] = low
                self.labels[low] += self.labels[high]

    def restrict(self, group: int, labels: np.ndarray) -> None:
        """Restrict the channels of a group to change places only with those of the same label.

        Parameters
        ----------
        group : int
            Number of a group.
        labels : ndarray, shape (c,)
            Label of each channel.
        """
        self.labels[self.root(group)].append(labels)

    def blocks(self, group: int) -> np.ndarray:
        """Compute which channels may change places, by all restrictions of the united groups.

        Parameters
        ----------
        group : int
            Number of a group.

        Returns
        -------
        ndarray of int, shape (c,)
            Label of each channel; channels with the same label may change places.
        """
        labels = [np.zeros(self.sizes[group], dtype=np.int64), *self.labels[self.root(group)]]
        return np.unique(np.stack(labels), axis=1, return_inverse=True)[1].reshape(-1)
