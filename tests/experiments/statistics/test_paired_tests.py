"""Paired tests against hand-worked values, written-out distributions and SciPy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from experiments.errors import InputError
from experiments.statistics import SignedRank, holm, mcnemar
from experiments.statistics.paired_tests import paired_differences

INF = math.inf


def test_five_units_all_better_reach_the_least_p_there_is() -> None:
    found = SignedRank()([0.9, 0.8, 0.7, 0.6, 0.5], [0.8, 0.6, 0.4, 0.2, 0.0])
    # 2 of 32 patterns of signs are as extreme.
    assert found.p == found.min_attainable_p == 0.0625
    assert (found.units, found.nonzero, found.rank_biserial) == (5, 5, 1.0)
    assert (found.positive_ranks, found.negative_ranks) == (15.0, 0.0)


def test_four_units_by_hand() -> None:
    # Differences 3, -1, 4, 2: positive ranks 3 + 4 + 2 = 9 of 10. Of 16 patterns two reach 9 or more (10, 9).
    found = SignedRank()([3, 0, 4, 2], [0, 1, 0, 0])
    assert found.p == 4 / 16
    assert SignedRank("greater")([3, 0, 4, 2], [0, 1, 0, 0]).p == 2 / 16
    assert SignedRank("less")([3, 0, 4, 2], [0, 1, 0, 0]).p == 15 / 16
    assert found.rank_biserial == pytest.approx((9 - 1) / 10)


def test_ties_and_zeros_by_hand() -> None:
    # Sizes 0, 1, 1, 2 rank 1, 2.5, 2.5, 4; the zero's rank is dropped. Positive 2.5 + 4, negative 2.5.
    # Sums of the 8 patterns of {2.5, 2.5, 4}: 0, 2.5, 2.5, 4, 5, 6.5, 6.5, 9: three reach 6.5.
    found = SignedRank()([1, 2, 1, 5], [1, 1, 2, 3])
    assert (found.units, found.nonzero) == (4, 3)
    assert (found.positive_ranks, found.negative_ranks) == (6.5, 2.5)
    assert found.p == 6 / 8 and found.min_attainable_p == 2 / 8


@pytest.mark.parametrize("n", [1, 6, 13, 30])
def test_without_ties_it_is_scipys_exact_test(n: int) -> None:
    random = np.random.default_rng(n)
    first, second = random.normal(0.3, 1, n), random.normal(0, 1, n)
    for ours, theirs in (("two_sided", "two-sided"), ("greater", "greater"), ("less", "less")):
        expected = stats.wilcoxon(first - second, alternative=theirs, method="exact").pvalue
        assert SignedRank(ours)(first, second).p == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("seed", range(6))
def test_with_ties_and_zeros_it_is_scipys_permutation_of_all_signs(seed: int) -> None:
    difference = np.random.default_rng(seed).integers(-3, 5, 11).astype(float)
    every_sign = stats.PermutationMethod(n_resamples=np.inf)
    expected = stats.wilcoxon(difference, zero_method="pratt", method=every_sign).pvalue
    assert SignedRank()(difference, np.zeros(11)).p == pytest.approx(expected, rel=1e-9)


def test_swapping_the_methods_mirrors_all() -> None:
    random = np.random.default_rng(2)
    first, second = random.normal(0.4, 1, 9), random.normal(0, 1, 9)
    one, other = SignedRank()(first, second), SignedRank()(second, first)
    assert one.p == other.p and one.rank_biserial == -other.rank_biserial
    assert SignedRank("greater")(first, second).p == SignedRank("less")(second, first).p


def test_failures_rank_worst_and_two_of_them_tie() -> None:
    # Errors: the first method fails in the third unit, both in the fourth.
    found = SignedRank()([1.0, 2.0, INF, INF], [3.0, 5.0, 9.0, INF])
    # Differences -2, -3, inf, 0 rank 2, 3, 4: one failure outweighs neither of the gains alone, but most in rank.
    assert (found.positive_ranks, found.negative_ranks, found.nonzero) == (4.0, 5.0, 3)
    assert SignedRank()([INF, INF], [1.0, 2.0]).positive_ranks == 3.0


def test_rounding_makes_no_order_of_what_is_equal() -> None:
    first, second = [0.3, 0.5, 0.8], [0.1, 0.3, 0.6]
    assert len({0.3 - 0.1, 0.5 - 0.3, 0.8 - 0.6}) > 1
    assert SignedRank()(first, second).positive_ranks == 6.0
    assert len(set(paired_differences(first, second))) == 1
    assert SignedRank()([0.1 + 0.2], [0.3]).nonzero == 0


def test_no_difference_at_all_shows_nothing() -> None:
    found = SignedRank()([0.5, 0.6], [0.5, 0.6])
    assert (found.p, found.min_attainable_p, found.rank_biserial, found.nonzero) == (1.0, 1.0, 0.0, 0)
    assert SignedRank()([0.0, 0.0], [0.0, 0.0]).p == 1.0


def test_more_units_than_are_counted_exactly_say_so() -> None:
    random = np.random.default_rng(0)
    difference = random.normal(0.06, 1, 1500)
    found = SignedRank()(difference, np.zeros(1500))
    assert not found.exact
    expected = stats.wilcoxon(difference, method="approx", correction=True).pvalue
    assert found.p == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(
    ("first", "second", "message"),
    [
        ([1.0], [1.0, 2.0], "first, second: expected one value a unit of each"),
        ([], [], "first, second: expected one value a unit of each"),
        ([1.0, math.nan], [1.0, 2.0], "received NaN"),
    ],
)
def test_refuses_what_are_no_pairs(first: list[float], second: list[float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        SignedRank()(first, second)


def test_refuses_an_alternative_that_is_none() -> None:
    with pytest.raises(InputError, match="alternative: expected one of two_sided, greater, less"):
        SignedRank("two-sided")  # type: ignore[arg-type]


def test_mcnemar_by_hand() -> None:
    # 6 rows only the first got, 1 only the second: P(0 or 1 of 7 heads) * 2 = 2 * 8 / 128.
    first = [1] * 6 + [0] + [1] * 10 + [0] * 3
    second = [0] * 6 + [1] + [1] * 10 + [0] * 3
    found = mcnemar(first, second, range(20))
    assert (found.first_only, found.second_only, found.rows, found.units) == (6, 1, 20, 20)
    assert found.p == 0.125 and found.min_attainable_p == 2 / 128


def test_mcnemar_with_one_row_a_unit_is_the_binomial_test() -> None:
    random = np.random.default_rng(1)
    first, second = random.random(80) < 0.8, random.random(80) < 0.6
    expected = stats.binomtest(int((first & ~second).sum()), int((first != second).sum())).pvalue
    assert mcnemar(first, second, range(80)).p == pytest.approx(expected)


def test_rows_of_one_unit_are_not_independent() -> None:
    first, second = [True] * 12, [False] * 12
    units = [row // 4 for row in range(12)]
    # Three units won by four rows each: 2 of 8 patterns of signs are as extreme, not 2 of 4096.
    assert mcnemar(first, second, units).p == 2 / 8
    assert mcnemar(first, second, range(12)).p == 2 / 4096
    # Surpluses 2, -1 and 0: sums of {2, 1} are 0, 1, 2, 3 and the one observed is 2.
    found = mcnemar([1, 1, 0, 1, 0], [0, 0, 1, 0, 1], ["a", "a", "b", "c", "c"])
    assert found.p == 1.0 and found.min_attainable_p == 0.5 and found.units == 3


def test_mcnemar_without_any_disagreement() -> None:
    assert mcnemar([1, 0], [1, 0], "ab").p == 1.0


def test_mcnemar_refuses() -> None:
    with pytest.raises(InputError, match="first: expected true or false in every row"):
        mcnemar([0.5, 1], [1, 0], "ab")
    with pytest.raises(InputError, match="expected one for each of 2 rows, received 1 and 2"):
        mcnemar([1, 0], [1], "ab")


def test_holm_by_hand() -> None:
    # Sorted 0.005, 0.01, 0.03, 0.04 times 4, 3, 2, 1: 0.02, 0.03, 0.06, 0.04, the last raised to 0.06.
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.6, 0.7]) == pytest.approx([1.0, 1.0])
    assert holm([0.2]) == pytest.approx([0.2])


def test_holm_leaves_out_a_test_that_was_not_made() -> None:
    found = holm([0.01, math.nan, 0.04])
    assert found[[0, 2]] == pytest.approx([0.02, 0.04]) and math.isnan(found[1])
    assert np.isnan(holm([math.nan])).all() and not len(holm([]))


def test_holm_refuses_what_is_no_p_value() -> None:
    with pytest.raises(InputError, match="p_values: expected numbers from 0 to 1"):
        holm([0.5, 1.5])
    assert holm([0.0, 1.0]).tolist() == [0.0, 1.0]


def test_mcnemar_says_which_of_the_two_is_no_success() -> None:
    for first, second, name in (([2, 1], [0, 1], "first"), ([0, 1], [2, 1], "second")):
        with pytest.raises(
            InputError, match=rf"^{name}: expected true or false in every row, received \[1, 2\]$"
        ):
            mcnemar(first, second, ["a", "b"])


def test_mcnemar_counts_who_won() -> None:
    won = mcnemar([1, 1, 1, 0], [0, 0, 0, 1], ["a", "b", "c", "d"])
    lost = mcnemar([0, 0, 0, 1], [1, 1, 1, 0], ["a", "b", "c", "d"])
    assert won.p == lost.p == 0.625
