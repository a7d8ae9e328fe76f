"""A comparison of two methods: its parts by their own functions, and what it may call equivalent."""

from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest

from experiments.errors import InputError
from experiments.statistics import Bootstrap, PairedComparison, SignedRank

SCORES = np.random.default_rng(0).beta(8, 2, 12)


def test_every_number_is_that_of_its_own_function() -> None:
    other = SCORES - np.linspace(-0.01, 0.05, 12)
    found = PairedComparison()(SCORES, other)
    assert found.units == 12 and found.equivalence is None
    assert found.first == Bootstrap()(SCORES) and found.second == Bootstrap()(other)
    assert found.mean_difference.estimate == pytest.approx(0.02)
    assert found.median_difference.estimate == pytest.approx(0.02)
    assert found.mean_difference.low == pytest.approx(Bootstrap()(SCORES - other).low)
    assert found.test == SignedRank()(SCORES, other)


def test_equivalence_by_hand() -> None:
    # Five units within half a point: both one-sided tests reach their least p, 1 of 32.
    difference = np.array([0.004, -0.003, 0.002, -0.001, 0.0005])
    found = PairedComparison(margin=0.01)(0.8 + difference, np.full(5, 0.8)).equivalence
    assert found is not None
    assert found.p == found.min_attainable_p == 1 / 32
    assert found.inside and found.interval.level == pytest.approx(0.9)


def test_too_few_units_are_never_equivalent() -> None:
    found = PairedComparison(margin=0.01)(np.full(4, 0.8), np.full(4, 0.8)).equivalence
    assert found is not None and found.inside
    assert found.p == found.min_attainable_p == 1 / 16


def test_a_difference_beyond_the_margin_is_not_equivalent_on_either_side() -> None:
    for shift in (0.03, -0.03):
        found = PairedComparison(margin=0.01)(SCORES + shift, SCORES).equivalence
        assert found is not None and found.p > 0.99 and not found.inside


def test_one_unit_that_differs_much_forbids_the_claim_that_ranks_would_make() -> None:
    other = SCORES.copy()
    other[3] -= 0.6
    found = PairedComparison(margin=0.01)(SCORES, other).equivalence
    assert found is not None
    assert found.p < 0.05 and not found.inside


def test_a_failure_of_one_method_is_neither_equal_nor_a_number() -> None:
    other = SCORES.copy()
    other[0] = -math.inf
    found = PairedComparison(margin=0.01)(SCORES, other)
    assert found.mean_difference.estimate == math.inf and found.second.estimate == -math.inf
    assert np.isfinite(found.median_difference.estimate)
    assert found.equivalence is not None and not found.equivalence.inside


def test_equivalence_is_claimed_wrongly_no_more_often_than_alpha() -> None:
    random = np.random.default_rng(3)
    compare = PairedComparison(margin=0.01, bootstrap=Bootstrap(resamples=200))
    claims = 0
    for _ in range(200):
        found = compare(random.normal(0.01, 0.01, 15), np.zeros(15)).equivalence
        assert found is not None
        claims += found.inside and found.p <= 0.05
    # At the margin itself: 5 % of 200 are 10, three standard deviations more are 19.
    assert claims <= 19


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"margin": 0.0}, "margin: expected a difference above 0, or none, received 0.0"),
        ({"margin": math.inf}, "margin: expected a difference above 0"),
        ({"alpha": 0.5}, "alpha: expected a level between 0 and 0.5, received 0.5"),
    ],
)
def test_refuses_settings(arguments: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        PairedComparison(**arguments)


def test_the_statistics_import_at_once(repository) -> None:
    code = (
        "import sys, experiments.statistics;"
        "print(sorted({'scipy', 'pandas', 'matplotlib', 'torch'} & set(sys.modules)))"
    )
    environment = {"PYTHONPATH": str(repository / "src"), "PATH": ""}
    found = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    assert found.stdout.strip() == "[]"


def test_equivalence_has_its_margin_and_the_interval_of_the_mean() -> None:
    """Whatever the statistic of the bootstrap that is given: medians would be blind to the unit that differs."""
    first = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    found = PairedComparison(margin=0.3, bootstrap=Bootstrap(statistic="median_of_units"))(first, np.zeros(6))
    assert found.equivalence is not None
    assert found.equivalence.margin == 0.3
    assert found.equivalence.interval.estimate == pytest.approx(1 / 6)
    assert not found.equivalence.inside
