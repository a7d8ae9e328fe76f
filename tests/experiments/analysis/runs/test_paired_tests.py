"""Paired tests of two runs: known answers, the least attainable p, and no claim from too few units."""

from __future__ import annotations

import math

import pandas as pd
import pytest
from run_families import alone, segmented, trials

from experiments.analysis.runs.paired_cases import PairedCases, pair_cases
from experiments.analysis.runs.paired_tests import MCNEMAR, compare_runs, strata_of, unit_values


def paired(first: pd.DataFrame, second: pd.DataFrame) -> PairedCases:
    return pair_cases(alone("a", first), alone("b", second))


def row_of(found: pd.DataFrame, metric: str) -> pd.Series:
    return found[found["metric"] == metric].iloc[0]


def test_eight_groups_that_all_rise_are_significant_and_the_first_is_named() -> None:
    second = [0.5 + number / 100 for number in range(8)]
    found = compare_runs(paired(segmented([value + 0.1 for value in second]), segmented(second)))
    row = row_of(found, "dsc")
    assert row["units"] == 8
    assert row["mean_difference"] == pytest.approx(0.1)
    assert row["p"] == pytest.approx(2 / 2**8)
    assert row["min_attainable_p"] == pytest.approx(2 / 2**8)
    assert row["p_holm"] == pytest.approx(2 * 2 / 2**8)
    assert row["verdict"] == "first better"
    # Less distance is better: the first is ahead with a negative difference.
    assert row_of(found, "hd95_px")["verdict"] == "first better"


def test_four_groups_can_show_nothing_and_the_least_p_says_so() -> None:
    found = compare_runs(paired(segmented([0.9] * 4), segmented([0.1, 0.2, 0.3, 0.4])))
    row = row_of(found, "dsc")
    assert row["min_attainable_p"] == pytest.approx(0.125)
    assert row["family_least"] == pytest.approx(0.25)
    assert row["verdict"] == "no difference shown"


def test_success_is_tested_by_mcnemar_with_the_anatomy_as_unit() -> None:
    first = trials({f"a{number}": [1.0, 1.0] for number in range(6)}, "multistart")
    second = trials({f"a{number}": [9.0, 1.0] for number in range(6)})
    row = row_of(compare_runs(paired(first, second)), "success_tre")
    assert (row["test"], row["first_only"], row["second_only"], row["units"], row["cases"]) == (
        MCNEMAR,
        6,
        0,
        6,
        12,
    )
    assert row["p"] == pytest.approx(2 / 2**6)
    assert row["verdict"] == "no difference shown"  # adjusted for four tests


def test_a_failure_ranks_worst_and_a_single_anatomy_shows_nothing() -> None:
    first = trials({"a0": [1.0, 1.0, 1.0]}, "multistart")
    row = row_of(compare_runs(paired(first, trials({"a0": [math.inf, math.inf, 1.0]}))), "tre_mm")
    assert (row["units"], row["p"], row["min_attainable_p"]) == (1, 1.0, 1.0)
    assert row["mean_difference"] == -math.inf
    assert math.isnan(row["mean_difference_ci_low"])
    assert row["verdict"] == "no difference shown"


def test_cases_without_a_value_in_either_run_do_not_count() -> None:
    first, second = segmented([0.9, 0.8, 0.7]), segmented([0.5, float("nan"), 0.4])
    found = paired(first, second)
    assert unit_values(found, "dsc", found.pairs).index.tolist() == ["g0", "g2"]
    assert "false_alarm" not in set(compare_runs(found)["metric"])


def test_methods_are_tested_apart() -> None:
    both = pd.concat([segmented([0.9, 0.8], "unet"), segmented([0.5, 0.6], "attention_unet")])
    found = paired(both, both.assign(dsc=0.4))
    assert [name for name, _ in strata_of(found)] == ["unet", "attention_unet"]
    assert compare_runs(found)["method"].tolist() == ["unet", "unet", "attention_unet", "attention_unet"]
