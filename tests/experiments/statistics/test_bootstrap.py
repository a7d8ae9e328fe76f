"""Bootstrap intervals against enumeration, SciPy, and how often they hold what they should."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy import stats

from experiments.errors import InputError
from experiments.statistics import Bootstrap

SCORES = np.random.default_rng(5).beta(8, 2, 25)


@pytest.mark.parametrize(
    ("statistic", "function"), [("mean_of_units", np.mean), ("median_of_units", np.median)]
)
def test_percentile_is_scipys_but_for_its_random_draws(statistic, function) -> None:
    found = Bootstrap(statistic, "percentile", resamples=40_000)(SCORES)
    expected = stats.bootstrap(
        (SCORES,), function, n_resamples=40_000, method="percentile", rng=np.random.default_rng(0)
    ).confidence_interval
    assert found.estimate == pytest.approx(function(SCORES))
    width = expected.high - expected.low
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high), abs=0.04 * width)
    assert (found.units, found.level) == (25, 0.95)


def test_percentile_of_three_values_by_enumeration() -> None:
    values = [1.0, 2.0, 6.0]
    means = sorted(np.mean(drawn) for drawn in itertools.product(values, repeat=3))
    # 27 equally likely resamples: at 70 % the bounds are the 5th from either end (0.15 * 27 = 4.05).
    found = Bootstrap(method="percentile", level=0.7, resamples=50_000)(values)
    assert (found.low, found.high) == pytest.approx((means[4], means[-5]))


def test_expanded_bounds_are_those_of_a_wider_percentile_interval() -> None:
    n = len(SCORES)
    level = 1 - 2 * stats.norm.cdf(math.sqrt(n / (n - 1)) * stats.t.ppf(0.025, n - 1))
    wider = Bootstrap(method="percentile", level=level)(SCORES)
    found = Bootstrap()(SCORES)
    assert (found.low, found.high) == (wider.low, wider.high)
    assert found.level == 0.95


def test_whole_groups_are_drawn() -> None:
    # Ten cases of each of four groups: as independent cases the interval would be a third as wide.
    values, groups = np.repeat([0.2, 0.5, 0.6, 0.9], 10), np.repeat(list("abcd"), 10)
    found = Bootstrap("mean_of_cases")(values, groups.tolist())
    of_units = Bootstrap("mean_of_units")([0.2, 0.5, 0.6, 0.9])
    assert (found.estimate, found.low, found.high) == pytest.approx((0.55, of_units.low, of_units.high))
    alone = Bootstrap("mean_of_cases")(values)
    assert (alone.high - alone.low) < 0.5 * (found.high - found.low)
    assert (found.units, alone.units) == (4, 40)


def test_cases_and_units_weigh_differently() -> None:
    values, groups = [1.0, 1.0, 1.0, 0.0], ["a", "a", "a", "b"]
    assert Bootstrap("mean_of_cases")(values, groups).estimate == 0.75
    assert Bootstrap("mean_of_units")(values, groups).estimate == 0.5


def test_expanded_holds_a_normal_mean_nearly_as_often_as_it_says() -> None:
    random = np.random.default_rng(1)
    samples = random.normal(0, 1, (300, 8))
    held = {
        method: np.mean(
            [
                interval.low <= 0 <= interval.high
                for sample in samples
                for interval in [Bootstrap(method=method, resamples=1000)(sample)]
            ]
        )
        for method in ("expanded", "percentile")
    }
    # Measured 0.95 and 0.90 over 1000 samples; three standard errors of 300 are 0.04 and 0.05.
    assert 0.91 <= held["expanded"] <= 0.99
    assert held["percentile"] < held["expanded"]


def test_the_seed_decides() -> None:
    assert Bootstrap(seed=3)(SCORES) == Bootstrap(seed=3)(SCORES)
    assert Bootstrap(seed=3)(SCORES) != Bootstrap(seed=4)(SCORES)


def test_more_indices_than_are_held_at_once() -> None:
    values = np.random.default_rng(0).normal(5, 1, 3000)
    found = Bootstrap(resamples=1500)(values)
    half = 1.96 * values.std() / math.sqrt(3000)
    assert (found.low, found.high) == pytest.approx(
        (values.mean() - half, values.mean() + half), abs=half / 10
    )


def test_failures_leave_no_plausible_bound() -> None:
    errors = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, math.inf]
    mean, median = Bootstrap()(errors), Bootstrap("median_of_units")(errors)
    assert mean.estimate == mean.high == math.inf and np.isfinite(mean.low)
    assert median.estimate == 4.5 and median.low < 4.5
    both = Bootstrap()([math.inf, -math.inf, 1.0])
    assert all(math.isnan(value) for value in (both.estimate, both.low, both.high))


def test_one_unit_has_no_interval_and_equal_ones_have_no_width() -> None:
    alone = Bootstrap("mean_of_cases")([0.5, 0.7], ["a", "a"])
    assert alone.estimate == pytest.approx(0.6) and alone.units == 1
    assert math.isnan(alone.low) and math.isnan(alone.high)
    same = Bootstrap()([0.25] * 6)
    assert (same.low, same.high) == (0.25, 0.25)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"statistic": "mode"}, "statistic: expected one of mean_of_units"),
        ({"method": "bca"}, "method: expected one of expanded, percentile"),
        ({"level": 95}, "level: expected a level between 0 and 1, received 95"),
        ({"resamples": 10}, "resamples: expected at least 100, received 10"),
    ],
)
def test_refuses_settings(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Bootstrap(**arguments)


def test_refuses_values() -> None:
    with pytest.raises(InputError, match="values: expected at least one number"):
        Bootstrap()([])
    with pytest.raises(InputError, match=r"values: expected failures as infinity .* received 1 NaN"):
        Bootstrap()([1.0, math.nan])
    with pytest.raises(InputError, match="units: expected one for each of 2 values, received 1"):
        Bootstrap()([1.0, 2.0], ["a"])


def test_a_ratio_of_means_draws_its_units_together() -> None:
    below = np.array([1.0, 2.0, 4.0, 8.0])
    found = Bootstrap().ratio(0.5 * below, below)
    assert (found.estimate, found.low, found.high, found.units) == pytest.approx((0.5, 0.5, 0.5, 4))
    uneven = Bootstrap().ratio([0.5, 1.0, 4.0, 8.0], below)
    assert uneven.estimate == pytest.approx(13.5 / 15) and uneven.low < 13.5 / 15 < uneven.high


def test_a_ratio_weighs_units_by_their_own_means() -> None:
    found = Bootstrap().ratio([1.0, 1.0, 4.0], [2.0, 2.0, 2.0], ["a", "a", "b"])
    assert found.estimate == pytest.approx(2.5 / 2.0) and found.units == 2


def test_a_ratio_over_nothing_is_none() -> None:
    assert np.isnan(Bootstrap().ratio([1.0, 2.0], [0.0, 0.0]).estimate)
    single = Bootstrap().ratio([1.0], [2.0])
    assert single.estimate == 0.5 and np.isnan(single.low)
    for above, below in (([1.0], [1.0, 2.0]), ([], []), ([np.inf], [1.0])):
        with pytest.raises(InputError, match="above, below"):
            Bootstrap().ratio(above, below)


def test_a_ratio_of_two_units_by_enumeration() -> None:
    """Of the four draws of two units one is the first twice, one the second twice: the ends of any interval."""
    found = Bootstrap(level=0.9, resamples=500).ratio([1.0, 6.0], [2.0, 3.0])
    assert (found.estimate, found.low, found.high) == pytest.approx((7 / 5, 0.5, 2.0))
    assert (found.level, found.units) == (0.9, 2)


def test_the_seed_decides_a_ratio_too() -> None:
    above, below = SCORES, SCORES[::-1]
    first = Bootstrap(resamples=100, seed=1).ratio(above, below)
    assert first == Bootstrap(resamples=100, seed=1).ratio(above, below)
    assert first != Bootstrap(resamples=100, seed=2).ratio(above, below)


def test_draws_with_nothing_below_rank_last() -> None:
    """One unit in three has anything below: 8 of 27 draws lack it, and their ratio is infinite or none."""
    found = Bootstrap(resamples=500).ratio([0.0, 0.0, 3.0], [0.0, 0.0, 2.0])
    assert (found.estimate, found.high) == (1.5, math.inf)


def test_a_ratio_without_bounds_has_its_level_and_units() -> None:
    nothing = Bootstrap(level=0.9).ratio([1.0, 2.0], [0.0, 0.0])
    single = Bootstrap(level=0.9).ratio([1.0], [2.0])
    assert np.isnan([nothing.estimate, nothing.low, nothing.high, single.low, single.high]).all()
    assert (nothing.level, nothing.units, single.level, single.units) == (0.9, 2, 0.9, 1)


@pytest.mark.parametrize(
    ("above", "below", "message"),
    [
        (
            [[1.0]],
            [[1.0]],
            r"^above, below: expected one number a case of each, received shapes \(1, 1\) and \(1, 1\)$",
        ),
        ([1.0], [1.0, 2.0], r"received shapes \(1,\) and \(2,\)$"),
        ([1.0, np.nan], [1.0, 2.0], r"^above, below: expected finite numbers, received others$"),
        ([1.0, 2.0], [1.0, np.inf], r"^above, below: expected finite numbers, received others$"),
    ],
)
def test_a_ratio_refuses_what_are_no_pairs(above: object, below: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Bootstrap().ratio(above, below)  # type: ignore[arg-type]
