"""Spearman's correlation against SciPy's, and an interval that knows which cases belong together."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import rankdata, spearmanr

from experiments.errors import InputError
from experiments.statistics import Bootstrap, Spearman

QUICK = Bootstrap(resamples=400)


def test_the_correlation_is_that_of_scipy_with_ties() -> None:
    random = np.random.default_rng(0)
    first, second = random.integers(0, 6, 40), random.integers(0, 6, 40)
    found = Spearman(QUICK)(first, second)
    assert found.estimate == pytest.approx(spearmanr(first, second).statistic)
    assert found.units == 40
    assert found.low < found.estimate < found.high


def test_failures_rank_beyond_all_others() -> None:
    dsc = [0.9, 0.8, 0.7, 0.0, 0.1]
    assert Spearman(QUICK)(dsc, [1.0, 2.0, 3.0, np.inf, 50.0]).estimate == pytest.approx(-1.0)
    tied = Spearman(QUICK)(dsc, [1.0, 2.0, 3.0, np.inf, np.inf])
    assert tied.estimate == pytest.approx(spearmanr(dsc, [1, 2, 3, 9, 9]).statistic)


def test_copies_of_cases_within_a_unit_make_no_interval_narrower() -> None:
    random = np.random.default_rng(1)
    first = random.normal(size=12)
    second = first + random.normal(size=12)
    once = Spearman(QUICK)(first, second)
    copied = Spearman(QUICK)(np.repeat(first, 5), np.repeat(second, 5), np.repeat(np.arange(12), 5))
    assert copied.units == once.units == 12
    assert copied.estimate == pytest.approx(once.estimate)
    assert (copied.low, copied.high) == pytest.approx((once.low, once.high))


def test_within_blocks_what_blocks_differ_by_does_not_count() -> None:
    # Each block falls, and blocks with larger values of the one have larger values of the other.
    blocks = np.repeat(np.arange(6), 3).tolist()
    first = np.tile([0.0, 1.0, 2.0], 6) + 10 * np.array(blocks)
    second = np.tile([2.0, 1.0, 0.0], 6) + 10 * np.array(blocks)
    assert Spearman(QUICK)(first, second, blocks).estimate > 0.9
    within = Spearman(QUICK)(first, second, blocks, within=blocks)
    assert (within.estimate, within.low, within.high) == pytest.approx((-1.0, -1.0, -1.0))
    # Two blocks a unit: fewer units, the same correlation.
    paired = Spearman(QUICK)(first, second, [block // 2 for block in blocks], within=blocks)
    assert (paired.estimate, paired.units) == pytest.approx((-1.0, 3))
    assert np.isnan(paired.low)


def test_few_units_have_no_bounds_and_constant_values_no_correlation() -> None:
    few = Spearman(QUICK)([1, 2, 3, 4], [1, 2, 4, 3])
    assert few.estimate == pytest.approx(0.8)
    assert np.isnan([few.low, few.high]).all()
    assert np.isnan(Spearman(QUICK)([1, 1, 1, 1, 1], [1, 2, 3, 4, 5]).estimate)
    alone = Spearman(QUICK)([1, 2, 3], [3, 2, 1], within=[0, 1, 2])
    assert np.isnan(alone.estimate)


def test_a_resample_that_does_not_vary_widens_the_interval() -> None:
    # One unit alone varies: resamples without it say nothing.
    found = Spearman(QUICK)([0, 0, 0, 0, 1], [0, 0, 0, 0, 1])
    assert (found.estimate, found.low, found.high) == pytest.approx((1.0, -1.0, 1.0))


@pytest.mark.parametrize(
    ("first", "second", "units", "message"),
    [
        ([1.0], [1.0, 2.0], None, "first, second: expected one value a case of each"),
        ([], [], None, "first, second: expected one value a case of each"),
        ([1.0, np.nan], [1.0, 2.0], None, "first, second: expected failures as infinity"),
        ([1.0, 2.0], [1.0, 2.0], ["a"], "units: expected one for each of 2 cases, received 1"),
    ],
)
def test_refuses_what_is_no_pair(first: object, second: object, units: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Spearman()(first, second, units)  # type: ignore[arg-type]


def test_ranks_within_blocks_are_those_of_scipy_with_ties() -> None:
    """The correlation of ranks less their block's mean, block by block, by SciPy's ranks and NumPy's correlation."""
    random = np.random.default_rng(3)
    blocks = np.repeat(np.arange(8), 5)
    first, second = random.integers(0, 3, 40) + 9 * blocks, random.integers(0, 4, 40)
    ranks = [
        np.concatenate([rankdata(values[blocks == block]) for block in range(8)])
        for values in (first, second)
    ]
    found = Spearman(QUICK)(first, second, blocks.tolist(), within=blocks.tolist())
    assert found.estimate == pytest.approx(np.corrcoef(*(rank - 3.0 for rank in ranks))[0, 1])
    # Resamples have whole blocks, whose ranks stay as they are.
    draws = np.random.default_rng(0).integers(0, 8, (2000, 8))
    parts = np.array(
        [
            [np.sum(a * b) for a, b in ((x, y), (x, x), (y, y))]
            for x, y in ((ranks[0][blocks == block] - 3, ranks[1][blocks == block] - 3) for block in range(8))
        ]
    )
    both, one, other = parts[draws].sum(axis=1).T
    expected = np.quantile(both / np.sqrt(one * other), [0.025, 0.975])
    percentile = Spearman(Bootstrap(method="percentile", resamples=2000, seed=1))
    interval = percentile(first, second, blocks.tolist(), within=blocks.tolist())
    assert (interval.low, interval.high) == pytest.approx(expected, abs=0.05)
    assert interval.level == 0.95


def test_every_unit_is_drawn() -> None:
    """Without the first unit, the only one that disagrees, all draws would correlate perfectly."""
    found = Spearman(QUICK)([0, 1, 2, 3, 4, 5], [9, 1, 2, 3, 4, 5])
    assert found.low < 0.0


def test_bounds_that_are_missing_have_a_level() -> None:
    assert Spearman(Bootstrap(level=0.9))([1, 2, 3], [1, 3, 2]).level == 0.9


def test_a_constant_measure_has_no_correlation_on_either_side() -> None:
    for first, second in (([1] * 5, [1, 2, 3, 4, 5]), ([1, 2, 3, 4, 5], [1] * 5), ([1] * 5, [2] * 5)):
        assert np.isnan(Spearman(QUICK)(first, second).estimate)


def test_blocks_that_are_missing_are_refused_by_name() -> None:
    with pytest.raises(InputError, match=r"^within: expected one for each of 2 cases, received 1$"):
        Spearman()([1.0, 2.0], [1.0, 2.0], within=["a"])
    undefined = r"^first, second: expected failures as infinity and undefined cases left out, received NaN$"
    with pytest.raises(InputError, match=undefined):
        Spearman()([1.0, 2.0], [1.0, np.nan])
