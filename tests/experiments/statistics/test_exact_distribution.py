"""The distribution of sign flips against all patterns of signs, written out."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.stats import binom

from experiments.statistics.exact_distribution import EXACT_UP_TO, tails


@pytest.mark.parametrize("weights", [[1], [2, 4, 6], [3, 3, 3, 8], [1, 5, 5, 7, 7, 7, 12]])
def test_tails_of_every_pattern(weights: list[int]) -> None:
    sums = [
        sum(weight for weight, kept in zip(weights, signs, strict=True) if kept)
        for signs in itertools.product((0, 1), repeat=len(weights))
    ]
    for positive in sorted(set(sums)):
        found = tails(np.array(weights), positive)
        assert found.at_most == np.mean([total <= positive for total in sums])
        assert found.at_least == np.mean([total >= positive for total in sums])
        assert found.min_one_sided == 0.5 ** len(weights) and found.exact


def test_equal_weights_are_binomial() -> None:
    found = tails(np.ones(60), 21)
    assert found.at_most == pytest.approx(binom.cdf(21, 60, 0.5))
    assert found.two_sided == pytest.approx(2 * binom.cdf(21, 60, 0.5))


def test_nothing_to_flip_says_nothing() -> None:
    found = tails(np.array([], dtype=int), 0)
    assert found.two_sided == found.min_two_sided == found.at_least == 1.0


def test_the_normal_tail_meets_the_exact_one() -> None:
    ranks = np.arange(1, EXACT_UP_TO + 1)
    positive = int(ranks.sum() * 0.53)
    exact = tails(ranks, positive)
    beyond = tails(np.append(ranks, 1), positive + 1)
    assert exact.exact and not beyond.exact
    assert beyond.at_least == pytest.approx(exact.at_least, rel=0.02)
    assert beyond.at_most == pytest.approx(exact.at_most, rel=0.02)
