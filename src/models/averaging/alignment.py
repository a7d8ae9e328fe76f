"""Alignment of one network's channels with another's by weight matching (Ainsworth et al., ICLR 2023)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from scipy.optimize import linear_sum_assignment
from torch import Tensor

from models.averaging.channel_groups import Layout
from models.averaging.channel_ties import ChannelTies
from models.averaging.members import combination
from models.errors import InputError
from models.weights import Weights, require_alike

# Permutations by group: channel i of the result is channel permutation[i] of the input.
Permutations = Mapping[int, np.ndarray]
# Smallest relative gain of the agreement; smaller ones are rounding.
_MIN_GAIN = 1e-6


@dataclass(frozen=True, eq=False)
class Alignment:
    """Result of ``WeightMatching``.

    Parameters
    ----------
    weights : dict of str to Tensor
        State dict of the moving network with its channels permuted: the same function of an image.
    permutations : mapping of int to ndarray
        By group of ``ChannelTies``, where the channels are taken from.
    agreement_before, agreement_after : float
        Inner product of both networks' parameters.
    sweeps : int
        Number of passes over all groups until nothing changed.
    """

    weights: dict[str, Tensor]
    permutations: Permutations
    agreement_before: float
    agreement_after: float
    sweeps: int

    @property
    def moved_channels(self) -> int:
        """Number of channels that have changed places."""
        return sum(int((taken != np.arange(len(taken))).sum()) for taken in self.permutations.values())


def permuted(weights: Weights, ties: ChannelTies, permutations: Permutations) -> dict[str, Tensor]:
    """Permute the channels of a state dict; the network computes the same but for rounding.

    Parameters
    ----------
    weights : Weights
        State dict of the network that ``ties`` were found for.
    ties : ChannelTies
        Axes that are permuted together.
    permutations : mapping of int to ndarray
        Permutations of any groups; the others are kept.

    Returns
    -------
    dict of str to Tensor
        The permuted state dict.
    """
    return {
        name: _permuted(tensor, ties.axes.get(name, {}), ties, permutations)
        for name, tensor in weights.items()
    }


def _permuted(
    tensor: Tensor, axes: Mapping[int, Layout], ties: ChannelTies, permutations: Permutations
) -> Tensor:
    for axis, layout in axes.items():
        if any(group in permutations for group in layout):
            places, begin = [], 0
            for group in layout:
                places.append(begin + permutations.get(group, np.arange(ties.size(group))))
                begin += ties.size(group)
            tensor = tensor.index_select(axis, torch.from_numpy(np.concatenate(places)).to(tensor.device))
    return tensor.clone()


@dataclass(frozen=True)
class WeightMatching:
    """Permutation of one network's channels so that its parameters agree best with another's.

    Parameters
    ----------
    max_sweeps : int, optional
        Largest number of passes over all groups.
    seed : int, optional
        Seed of the order in which the groups are taken.

    Raises
    ------
    InputError
        If ``max_sweeps`` is below 1.

    Notes
    -----
    Coordinate descent on the inner product of all parameters: in turn, for each group of channels with all
    others fixed, the best order is a linear assignment.

    References
    ----------
    S. Ainsworth, J. Hayase and S. Srinivasa, ICLR 2023, Algorithm 1.
    """

    max_sweeps: int = 50
    seed: int = 0

    def __post_init__(self) -> None:
        if self.max_sweeps < 1:
            raise InputError(f"max_sweeps: expected at least 1, received {self.max_sweeps}")

    @torch.no_grad()
    def __call__(self, reference: Weights, moving: Weights, ties: ChannelTies) -> Alignment:
        """Align one network with another.

        Parameters
        ----------
        reference : Weights
            State dict of the network that stays as it is.
        moving : Weights
            State dict of the network whose channels are permuted.
        ties : ChannelTies
            Axes that are permuted together in networks of this architecture.

        Returns
        -------
        Alignment
            The permuted network and how well both agree.

        Raises
        ------
        InputError
            If the state dicts are not both those of the network of ``ties``.
        """
        require_alike({"the reference": reference, "the network to align": moving})
        if missing := sorted(ties.axes.keys() - reference.keys()):
            raise InputError(
                f"weights: expected those of the network that was followed, found no {missing[0]}"
            )
        matcher = _Matcher(reference, moving, ties)
        before = matcher.agreement(ties.parameters)
        generator = np.random.default_rng(self.seed)
        sweeps, changed = 0, True
        while changed and sweeps < self.max_sweeps:
            changed = False
            for group in generator.permutation(ties.movable):
                changed |= matcher.improve(int(group))
            sweeps += 1
        return Alignment(
            permuted(moving, ties, matcher.permutations),
            dict(matcher.permutations),
            before,
            matcher.agreement(ties.parameters),
            sweeps,
        )


class _Matcher:
    """The state of one coordinate descent."""

    def __init__(self, reference: Weights, moving: Weights, ties: ChannelTies) -> None:
        self.reference, self.moving, self.ties = reference, moving, ties
        self.permutations = {group: np.arange(ties.size(group)) for group in ties.movable}
        # By group: the tensors, axes and first channels where it lies.
        self.places: dict[int, list[tuple[str, int, int]]] = {group: [] for group in ties.movable}
        for name in sorted(ties.parameters):
            for axis, layout in ties.axes[name].items():
                begin = 0
                for group in layout:
                    if group in self.places:
                        self.places[group].append((name, axis, begin))
                    begin += ties.size(group)

    def agreement(self, names: frozenset[str] | set[str]) -> float:
        """The inner product of the reference and the permuted network over these tensors."""
        return sum(
            float((self.reference[name].double() * self._current(name).double()).sum())
            for name in sorted(names)
        )

    def _current(self, name: str) -> Tensor:
        return _permuted(self.moving[name], self.ties.axes[name], self.ties, self.permutations)

    def improve(self, group: int) -> bool:
        """Put one group in its best order with all others kept; whether that changed anything."""
        similarity = self._similarity(group)
        before = self.permutations[group]
        after = before.copy()
        for label in np.unique(self.ties.blocks[group]):
            channels = np.flatnonzero(self.ties.blocks[group] == label)
            _, taken = linear_sum_assignment(similarity[np.ix_(channels, channels)], maximize=True)
            after[channels] = channels[taken]
        if np.array_equal(before, after):
            return False
        # Where a group lies on two axes of one tensor, the assignment is not exact: only a true gain is kept.
        names = {name for name, _, _ in self.places[group]}
        agreement = self.agreement(names)
        self.permutations[group] = after
        if self.agreement(names) > agreement + _MIN_GAIN * abs(agreement):
            return True
        self.permutations[group] = before
        return False

    def _similarity(self, group: int) -> np.ndarray:
        """Inner products of the reference's channels (rows) with the moving network's in their own order."""
        size = self.ties.size(group)
        total = torch.zeros(size, size, dtype=torch.float64)
        for name, axis, begin in self.places[group]:
            others = {each: layout for each, layout in self.ties.axes[name].items() if each != axis}
            moving = _permuted(self.moving[name], others, self.ties, self.permutations)
            rows, columns = (
                tensor.narrow(axis, begin, size).movedim(axis, 0).reshape(size, -1).float()
                for tensor in (self.reference[name], moving)
            )
            total += (rows @ columns.T).cpu().double()
        return total.numpy()


def align_all(
    weights: Sequence[Weights], ties: ChannelTies, matching: WeightMatching, *, max_rounds: int = 20
) -> list[dict[str, Tensor]]:
    """Align several networks: each in turn with the mean of the others, until no channel moves.

    Parameters
    ----------
    weights : sequence of Weights
        State dicts of the network that ``ties`` were found for; at least two.
    ties : ChannelTies
        Axes that are permuted together.
    matching : WeightMatching
        Alignment of two networks.
    max_rounds : int, optional
        Largest number of passes over all networks.

    Returns
    -------
    list of dict of str to Tensor
        State dicts in the order given, each the same function as before.

    Raises
    ------
    InputError
        If there are fewer than two networks.

    References
    ----------
    S. Ainsworth, J. Hayase and S. Srinivasa, ICLR 2023, Algorithm 3 ("MergeMany"), started from the networks
    aligned with the first.
    """
    if len(weights) < 2:
        raise InputError(f"weights: expected at least two networks to align, received {len(weights)}")
    aligned: list[dict[str, Tensor]] = [dict(weights[0])]
    aligned += [matching(weights[0], moving, ties).weights for moving in weights[1:]]
    if len(weights) == 2:
        return aligned
    for _ in range(max_rounds):
        moved = 0
        for index, moving in enumerate(aligned):
            others: list[Weights] = [each for at, each in enumerate(aligned) if at != index]
            found = matching(combination(others, [1 / len(others)] * len(others)), moving, ties)
            aligned[index] = found.weights
            moved += found.moved_channels
        if not moved:
            break
    return aligned
