"""Uniform and greedy averages of trained networks."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from torch import Tensor

from models.averaging.members import Member, combination, require_averageable
from models.errors import InputError
from models.weights import Weights


@dataclass(frozen=True, eq=False)
class GreedyAverage:
    """Result of ``greedy_average``.

    Parameters
    ----------
    weights : dict of str to Tensor
        State dict of the average.
    members : tuple of str
        Names of the networks in it, in the order in which they were added.
    score : float
        Score of the average.
    member_scores : tuple of float
        Score of each network, in the order given.
    """

    weights: dict[str, Tensor]
    members: tuple[str, ...]
    score: float
    member_scores: tuple[float, ...]


def uniform_average(members: Sequence[Member], *, same_start: bool = True) -> dict[str, Tensor]:
    """Compute the mean of all members' weights.

    Statistics of batch normalisation are averaged like the rest, which is not what they are in the averaged
    network: see ``models.averaging.batch_statistics``.

    Parameters
    ----------
    members : sequence of Member
        Networks of one architecture, trained from one start.
    same_start : bool, optional
        As in ``models.averaging.members.require_averageable``.

    Returns
    -------
    dict of str to Tensor
        State dict of the average.

    Raises
    ------
    InputError
        If the members can't be averaged.

    References
    ----------
    M. Wortsman et al., ICML 2022 ("uniform soup").
    """
    require_averageable(members, same_start=same_start)
    return combination([member.weights for member in members], [1 / len(members)] * len(members))


def greedy_average(
    members: Sequence[Member],
    score: Callable[[Weights], float],
    *,
    refresh: Callable[[Weights], Weights] | None = None,
    same_start: bool = True,
) -> GreedyAverage:
    """Compute the average to which networks are added, best first, as long as its score does not fall.

    A network that lowers the score is skipped and the next one is tried. Equal scores keep the order given.

    Parameters
    ----------
    members : sequence of Member
        Networks of one architecture, trained from one start.
    score : callable
        Score of a state dict on selection data, higher is better.
    refresh : callable or None, optional
        Applied to an average of several networks before it is scored, such as re-estimation of batch
        normalisation statistics; single networks are scored as they are.
    same_start : bool, optional
        As in ``models.averaging.members.require_averageable``.

    Returns
    -------
    GreedyAverage
        The average, its members and scores.

    Raises
    ------
    InputError
        If the members can't be averaged, or a score is NaN.

    References
    ----------
    M. Wortsman et al., ICML 2022, Recipe 1 ("greedy soup").
    """
    require_averageable(members, same_start=same_start)
    scores = [_defined(score(member.weights), member.name) for member in members]
    best_first = sorted(range(len(members)), key=lambda index: -scores[index])
    chosen = [best_first[0]]
    weights: Weights = members[chosen[0]].weights
    best = scores[chosen[0]]
    for index in best_first[1:]:
        tried = [*chosen, index]
        average: Weights = combination(
            [members[each].weights for each in tried], [1 / len(tried)] * len(tried)
        )
        if refresh is not None:
            average = refresh(average)
        received = _defined(score(average), f"the average with {members[index].name}")
        if received >= best:
            chosen, weights, best = tried, average, received
    return GreedyAverage(
        {name: tensor.detach().clone() for name, tensor in weights.items()},
        tuple(members[index].name for index in chosen),
        best,
        tuple(scores),
    )


def _defined(score: float, of: str) -> float:
    if math.isnan(score):
        raise InputError(f"score of {of}: expected a number, received NaN")
    return float(score)
