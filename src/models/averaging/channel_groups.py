"""Groups of channels that must be permuted together, as they are found out one tie after the other."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from models.errors import InputError

# The groups of channels that lie one after the other on an axis.
Layout = tuple[int, ...]


@dataclass
class ChannelGroups:
    """Groups of channels, some of which are found to be one (a union-find forest).

    Parameters
    ----------
    sizes : list of int
        Number of channels of each group.
    parents : list of int
        For each group one that it is united with, itself for a root.
    labels : list of list of ndarray
        For each group the restrictions, one label for each channel.
    """

    sizes: list[int] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    labels: list[list[np.ndarray]] = field(default_factory=list)

    def new(self, size: int) -> int:
        """Add a group of channels that nothing is known of.

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
        """Find the group that stands for this one and all united with it.

        Parameters
        ----------
        group : int
            Number of a group.

        Returns
        -------
        int
            Number of the group that stands for it.
        """
        while self.parents[group] != group:
            group = self.parents[group]
        return group

    def unite(self, first: Layout, second: Layout, where: str) -> None:
        """Let channels of equal place move together.

        Parameters
        ----------
        first, second : tuple of int
            Groups of two layouts, in the order of their channels.
        where : str
            Where in the network they are joined, for messages.

        Raises
        ------
        InputError
            If the channels are grouped otherwise.
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
        """Let channels change places only with those of the same label.

        Parameters
        ----------
        group : int
            Number of a group.
        labels : ndarray of int
            One label for each channel.
        """
        self.labels[self.root(group)].append(labels)

    def blocks(self, group: int) -> np.ndarray:
        """Combine all restrictions of the united groups.

        Parameters
        ----------
        group : int
            Number of a group.

        Returns
        -------
        ndarray of int
            One label for each channel; channels of the same label may change places.
        """
        labels = [np.zeros(self.sizes[group], dtype=np.int64), *self.labels[self.root(group)]]
        return np.unique(np.stack(labels), axis=1, return_inverse=True)[1].reshape(-1)
