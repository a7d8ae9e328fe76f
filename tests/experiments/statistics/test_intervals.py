"""Intervals and summaries against published and hand-worked values."""

from __future__ import annotations

import math

import pytest
from scipy.stats import binomtest

from experiments.errors import InputError
from experiments.statistics import summary, wilson_interval, wilson_of_rate


@pytest.mark.parametrize(
    "successes, trials, low, high",
    [
        # Newcombe, Statist. Med. 17 (1998), table I, method 3.
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ],
)
def test_wilson_is_newcombes_table(successes: int, trials: int, low: float, high: float) -> None:
    interval = wilson_interval(successes, trials)
    assert (round(interval.low, 4), round(interval.high, 4)) == (low, high)
    assert interval.rate == successes / trials


def test_wilson_by_its_formula_at_another_level() -> None:
    z, n, p = 1.6448536269514722, 30, 17 / 30
    middle, half = (p + z * z / (2 * n)), z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    interval = wilson_interval(17, 30, level=0.9)
    assert interval.low == pytest.approx((middle - half) / (1 + z * z / n))
    assert interval.high == pytest.approx((middle + half) / (1 + z * z / n))


def test_wilson_mirrors_failures_and_reaches_one() -> None:
    assert wilson_interval(60, 60).high == 1
    assert wilson_interval(60, 60).low == pytest.approx(1 - wilson_interval(0, 60).high)


@pytest.mark.parametrize(
    "arguments, name",
    [((0, 0), "trials"), ((3, 2), "successes"), ((-1, 2), "successes"), ((1, 2, 1.0), "level")],
)
def test_wilson_refuses_what_is_no_proportion(arguments: tuple[float, ...], name: str) -> None:
    with pytest.raises(InputError, match=f"{name}: expected"):
        wilson_interval(*arguments)


@pytest.mark.parametrize(
    ("successes", "trials", "level"), [(0, 7, 0.95), (3, 7, 0.9), (7, 7, 0.99), (41, 300, 0.95)]
)
def test_wilson_is_scipys(successes: int, trials: int, level: float) -> None:
    expected = binomtest(successes, trials).proportion_ci(level, method="wilson")
    found = wilson_interval(successes, trials, level)
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high), abs=1e-12)


def test_a_mean_rate_lies_between_those_of_whole_counts() -> None:
    between = wilson_of_rate(4.5 / 30, 30)
    fewer, more = wilson_interval(4, 30), wilson_interval(5, 30)
    assert fewer.low < between.low < more.low and fewer.high < between.high < more.high
    assert (between.estimate, between.units) == (0.15, 30)
    with pytest.raises(InputError, match=r"rate: expected 0 to 1, received 1\.5"):
        wilson_of_rate(1.5, 3)
    with pytest.raises(InputError, match="trials: expected at least 1"):
        wilson_of_rate(0.5, 0)


def test_summary_by_hand() -> None:
    found = summary("tre_mm", [4.0, 1.0, 2.0, 3.0, 10.0])
    assert found == {
        "tre_mm_mean": 4.0,
        "tre_mm_std": pytest.approx(math.sqrt(50 / 4)),
        "tre_mm_median": 3.0,
        "tre_mm_p95": pytest.approx(8.8),
        "tre_mm_n": 5.0,
    }


def test_failures_rank_worst_and_never_leave_a_plausible_mean() -> None:
    found = summary("tre_mm", [1.0, 2.0, 3.0, math.inf])
    assert found["tre_mm_median"] == 2.5
    assert found["tre_mm_mean"] == math.inf
    assert math.isnan(found["tre_mm_std"])
    assert found["tre_mm_p95"] == math.inf
    assert summary("tre_mm", [math.inf, math.inf])["tre_mm_median"] == math.inf
    undefined = summary("tre_mm", [1.0, math.nan, 3.0])
    assert all(math.isnan(undefined[f"tre_mm_{kind}"]) for kind in ("mean", "std", "median", "p95"))
    assert undefined["tre_mm_n"] == 3


def test_one_case_has_no_spread_and_none_no_summary() -> None:
    assert math.isnan(summary("x", [2.0])["x_std"])
    with pytest.raises(InputError, match="x: expected at least one case"):
        summary("x", [])


def test_one_trial_and_no_success_are_proportions_too() -> None:
    one = wilson_interval(1, 1)
    assert (one.successes, one.trials, one.rate, one.high) == (1, 1, 1.0, 1.0)
    assert one.low == pytest.approx(1 / (1 + 1.959964**2), abs=1e-6)
    assert wilson_interval(0, 7).low == 0.0 and wilson_of_rate(0.0, 1, 0.9).low == 0.0
    assert wilson_of_rate(0.25, 8, 0.9).level == 0.9


def test_two_cases_have_a_spread_and_whole_numbers_a_mean() -> None:
    found = summary("tre_mm", [1, 2])
    assert found["tre_mm_std"] == pytest.approx(math.sqrt(0.5)) and found["tre_mm_mean"] == 1.5
    assert math.isnan(summary("tre_mm", [1.0, math.inf])["tre_mm_std"])
