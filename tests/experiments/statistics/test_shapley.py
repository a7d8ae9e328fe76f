"""Shapley values against games whose values are known."""

from __future__ import annotations

import numpy as np
import pytest

from experiments.errors import InputError
from experiments.statistics.shapley import coalitions, shapley_values


def test_all_subsets_once() -> None:
    subsets = coalitions(["a", "b", "c"])
    assert len(subsets) == len(set(subsets)) == 8
    assert subsets[0] == frozenset()
    assert subsets[-1] == {"a", "b", "c"}


def test_the_gloves_game() -> None:
    # One left glove, two right ones; a pair is worth 1 (textbook example: 2/3, 1/6, 1/6).
    worth = {
        subset: float("left" in subset and len(subset) > 1) for subset in coalitions(["left", "r1", "r2"])
    }
    values = shapley_values(["left", "r1", "r2"], worth)
    assert values == pytest.approx({"left": 2 / 3, "r1": 1 / 6, "r2": 1 / 6})


def test_independent_causes_keep_their_own_part_and_the_rest_adds_up() -> None:
    players, own = ["a", "b", "c", "d"], {"a": 1.0, "b": -2.0, "c": 0.5, "d": 0.0}
    added = {subset: 3.0 + sum(own[player] for player in subset) for subset in coalitions(players)}
    assert shapley_values(players, added) == pytest.approx(own)
    # Errors that add as squares: equal ones share alike.
    root = {subset: float(np.sqrt(len(subset))) for subset in coalitions(players)}
    assert shapley_values(players, root) == pytest.approx(dict.fromkeys(players, 0.5))


def test_what_is_missing_is_refused() -> None:
    worth = dict.fromkeys(coalitions(["a", "b"]), 1.0)
    del worth[frozenset({"a"})]
    with pytest.raises(InputError, match="expected all 4 subsets, received none of"):
        shapley_values(["a", "b"], worth)
    for wrong in ([], ["a", "a"]):
        with pytest.raises(InputError, match="players: expected names, each once"):
            coalitions(wrong)
