"""Division of cases into parts by whole groups, so that the parts are alike in size and in vessel area."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int, Shaped

from models.labelled_frames import LabelledFrames

AREA_CLASSES = 4
Indices = Int[np.ndarray, " _"]


def area_classes(frames: LabelledFrames) -> Int[np.ndarray, " n"]:
    """Classify cases by the share of the image that the vessel fills.

    Parameters
    ----------
    frames : LabelledFrames
        n cases.

    Returns
    -------
    ndarray of int, shape (n,)
        0 for a case without vessel, else 1 to 4 by quartile of the share.
    """
    shares = np.array([mask.mean() for mask in frames.masks])
    classes = np.zeros(len(shares), dtype=np.int64)
    shown = shares > 0
    if shown.any():
        limits = np.quantile(shares[shown], np.linspace(0, 1, AREA_CLASSES + 1)[1:-1])
        classes[shown] = 1 + np.searchsorted(limits, shares[shown])
    return classes


@dataclass(frozen=True)
class GroupedCases:
    """What dividing a data set needs of it. Cases are given by index.

    Parameters
    ----------
    ids : tuple of str
        Name of each of n cases.
    groups : ndarray of str, shape (n,)
        Group of each case.
    classes : ndarray of int, shape (n,)
        Area class of each case, see ``area_classes``.
    """

    ids: tuple[str, ...]
    groups: Shaped[np.ndarray, " n"]
    classes: Int[np.ndarray, " n"]

    @staticmethod
    def of(frames: LabelledFrames) -> GroupedCases:
        """Take the cases of a data set.

        Parameters
        ----------
        frames : LabelledFrames
            All cases.

        Returns
        -------
        GroupedCases
            Names, groups and area classes.
        """
        return GroupedCases(frames.case_ids, np.array(frames.groups), area_classes(frames))

    def group_of(self) -> dict[str, str]:
        """Return the group of each case.

        Returns
        -------
        dict of str to str
            Group by name.
        """
        return dict(zip(self.ids, self.groups.tolist(), strict=True))

    def names(self, cases: Indices) -> tuple[str, ...]:
        """Return the names of cases.

        Parameters
        ----------
        cases : ndarray of int, shape (m,)
            Indices.

        Returns
        -------
        tuple of str
            Names.
        """
        return tuple(self.ids[case] for case in cases)

    def in_groups(self, groups: Collection[str]) -> Indices:
        """Return the cases of groups.

        Parameters
        ----------
        groups : collection of str
            Group names.

        Returns
        -------
        ndarray of int, shape (m,)
            Indices.
        """
        return np.flatnonzero(np.isin(self.groups, list(groups)))

    def count_groups(self, cases: Indices) -> int:
        """Count the groups of cases.

        Parameters
        ----------
        cases : ndarray of int, shape (m,)
            Indices.

        Returns
        -------
        int
            Number of different groups.
        """
        return len(set(self.groups[cases]))

    def divide(self, cases: Indices, shares: Sequence[float], seed: int) -> list[Indices]:
        """Divide cases by whole groups, as the function ``divide`` does.

        Parameters
        ----------
        cases : ndarray of int, shape (m,)
            Indices.
        shares : sequence of float
            Share of each part; they add up to 1.
        seed : int
            Seed of the order among equals.

        Returns
        -------
        list of ndarray of int
            Indices of each part.
        """
        return [cases[part] for part in divide(self.classes[cases], self.groups[cases], shares, seed)]

    def stopping_part(self, cases: Indices, parts: int, seed: int) -> Indices:
        """Choose the part that stops a training early.

        Parameters
        ----------
        cases : ndarray of int, shape (m,)
            Indices of the cases to train with.
        parts : int
            The part is one in so many, at least one group.
        seed : int
            Seed of the order among equals.

        Returns
        -------
        ndarray of int
            Indices of the part.
        """
        parts = min(parts, self.count_groups(cases))
        return self.divide(cases, [1 / parts] * parts, seed)[0]


def divide(
    classes: Int[np.ndarray, " n"], groups: Shaped[np.ndarray, " n"], shares: Sequence[float], seed: int
) -> list[Indices]:
    """Divide cases by whole groups into parts that are alike in size and classes.

    Parameters
    ----------
    classes : ndarray of int, shape (n,)
        Class of each case.
    groups : ndarray of str, shape (n,)
        Group of each case.
    shares : sequence of float
        Share of each part; they add up to 1.
    seed : int
        Seed of the order among groups of equal size.

    Returns
    -------
    list of ndarray of int
        Indices of each part; none is empty where there are as many groups.

    Notes
    -----
    From the largest group to the smallest, in random order among equals, each goes to the part that is
    furthest below its share of what the group brings, counted in cases and in cases of each class: that adds
    least to the squared differences between parts and shares. scikit-learn's StratifiedGroupKFold looks at
    classes alone: it divided six sweeps of equal length 3 to 2 to 1.
    """
    names, member = np.unique(groups, return_inverse=True)
    counts = np.zeros((len(names), AREA_CLASSES + 1))
    np.add.at(counts, (member, classes), 1)
    sizes = counts.sum(axis=1)
    present = counts.sum(axis=0) > 0
    fractions = counts[:, present] / counts[:, present].sum(axis=0)
    # Size weighs as much as all classes together.
    weighed = np.column_stack([fractions, np.sqrt(present.sum()) * sizes / sizes.sum()])
    # What all parts have in common makes no difference: for equal shares there is nothing to add or to round.
    above, total = np.asarray(shares, dtype=np.float64) - min(shares), weighed.sum(axis=0)
    filled, part_of = np.zeros((len(above), weighed.shape[1])), np.zeros(len(names), dtype=np.int64)
    empty = np.ones(len(above), dtype=bool)
    shuffled = np.random.default_rng(seed).permutation(len(names))
    for done, group in enumerate(shuffled[np.argsort(-sizes[shuffled], kind="stable")]):
        excess = filled @ weighed[group] - above * (total @ weighed[group])
        if len(names) - done <= empty.sum():  # every group that is left is needed to fill an empty part
            excess[~empty] = np.inf
        part = int(np.argmin(excess))
        part_of[group], empty[part] = part, False
        filled[part] += weighed[group]
    return [np.flatnonzero(part_of[member] == part) for part in range(len(above))]
