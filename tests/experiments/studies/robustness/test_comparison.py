"""Methods against each other: the anatomy is the unit, and one anatomy allows no test."""

from __future__ import annotations

import pandas as pd
import pytest
from robustness_rows import FAR, GOOD, row

from experiments.studies.robustness.comparison import by_anatomy, comparison


def outcomes(method: str, right: str, anatomy: str = "aorta") -> list[dict]:
    return [
        row(method, trial=n, anatomy=anatomy, tre_mm=GOOD if one == "+" else FAR)
        for n, one in enumerate(right)
    ]


def test_with_one_anatomy_mcnemar_describes_the_trials_alone() -> None:
    cases = pd.DataFrame([*outcomes("single_icp", "+---+-"), *outcomes("multistart", "+++++-")])
    (only,) = comparison(cases).to_dict("records")
    assert (only["first"], only["second"]) == ("multistart", "single_icp")
    assert only["unit"] == "trial (one anatomy: description only)"
    assert (only["problems"], only["first_only"], only["second_only"]) == (6, 3, 0)
    assert only["mcnemar_p"] == 0.25
    assert "signed_rank_p" not in only and "mcnemar_p_holm" not in only


def test_with_several_anatomies_each_counts_once() -> None:
    cases = pd.DataFrame(
        [
            each
            for number in range(6)
            for name, right in (("multistart", "++++"), ("single_icp", "+---"), ("gicp", "++++"))
            for each in outcomes(name, right, f"anatomy-{number}")
        ]
    )
    table = comparison(cases).set_index("second")
    assert table["unit"].tolist() == ["anatomy", "anatomy"]
    assert table.loc["single_icp", ["units", "problems", "first_only"]].tolist() == [6, 24, 18]
    # Six units that all fall on one side: two in 2^6.
    assert table.loc["single_icp", "mcnemar_p"] == pytest.approx(2 / 64)
    assert table.loc["single_icp", "signed_rank_p"] == pytest.approx(2 / 64)
    assert table.loc["single_icp", "rank_biserial"] == 1
    assert table.loc["single_icp", "signed_rank_p_holm"] == pytest.approx(4 / 64)
    assert table.loc["gicp", "mcnemar_p"] == 1


def test_only_the_same_problems_are_compared() -> None:
    one, other = outcomes("a", "++"), outcomes("b", "+-")
    other[1]["overlap"] = 0.6
    (only,) = comparison(pd.DataFrame([*one, *other])).to_dict("records")
    assert (only["first"], only["problems"], only["first_only"]) == ("a", 1, 0)
    for each in other:
        each["overlap"] = 0.4
    assert not len(comparison(pd.DataFrame([*one, *other])))
    assert not len(comparison(pd.DataFrame(one)))


def test_levels_of_factors_are_told_apart_in_the_pairing() -> None:
    cases = [
        row(name, factor=factor, level=level)
        for name in ("a", "b")
        for factor, level in (("rotation", float("nan")), ("noise_mm", 0.0), ("noise_mm", 1.0))
    ]
    assert comparison(pd.DataFrame(cases))["problems"].tolist() == [3]


def test_rates_over_anatomies_have_the_anatomy_for_a_unit() -> None:
    """Three anatomies with one, two and three of four right: the mean of the rates, whatever their trials."""
    cases = pd.DataFrame(
        [
            *outcomes("a", "+---", "first"),
            *outcomes("a", "++--", "second"),
            *outcomes("a", "+++-" * 5, "third"),
        ]
    )
    (only,) = by_anatomy(cases).to_dict("records")
    assert (only["anatomies"], only["trials"]) == (3, 28)
    assert only["success_tre_rate"] == 0.5
    assert only["success_tre_rate_low"] <= 0.25 and only["success_tre_rate_high"] >= 0.75
    assert (only["worst_anatomy"], only["worst_rate"]) == ("first", 0.25)
    assert not len(by_anatomy(cases[cases["anatomy"] == "first"]))
