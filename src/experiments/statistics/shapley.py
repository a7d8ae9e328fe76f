"""Exact Shapley values: how much each of several causes has a part in an effect that they have together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from math import factorial

from experiments.errors import InputError


def coalitions(players: Sequence[str]) -> list[frozenset[str]]:
    """List all subsets, from the empty one to the whole.

    Parameters
    ----------
    players : sequence of str
        Names of the causes, each once.

    Returns
    -------
    list of frozenset
        The 2^n subsets.

    Raises
    ------
    InputError
        If there is none, or one is there twice.
    """
    if not players or len(set(players)) != len(players):
        raise InputError(f"players: expected names, each once, received {', '.join(players) or 'none'}")
    return [frozenset(chosen) for size in range(len(players) + 1) for chosen in combinations(players, size)]


def shapley_values(players: Sequence[str], worth: Mapping[frozenset[str], float]) -> dict[str, float]:
    """Compute the mean gain of each player over all orders in which players may join.

    Parameters
    ----------
    players : sequence of str
        Names of the players, each once.
    worth : mapping of frozenset to float
        What each subset is worth.

    Returns
    -------
    dict
        Value of each player; they add up to the worth of the whole less that of the empty subset.

    Raises
    ------
    InputError
        If a subset is missing.

    References
    ----------
    L. S. Shapley, Contributions to the Theory of Games II, Princeton, 1953.
    """
    subsets = coalitions(players)
    missing = [subset for subset in subsets if subset not in worth]
    if missing:
        raise InputError(f"worth: expected all {len(subsets)} subsets, received none of {sorted(missing[0])}")
    count = len(players)
    values = dict.fromkeys(players, 0.0)
    for subset in subsets:
        weight = factorial(len(subset)) * factorial(count - len(subset) - 1) if len(subset) < count else 0
        for player in set(players) - subset:
            values[player] += weight * (worth[subset | {player}] - worth[subset]) / factorial(count)
    return values
