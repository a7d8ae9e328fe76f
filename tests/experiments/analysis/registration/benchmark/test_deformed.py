"""Errors before and after a displacement, paired over anatomies."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from experiments.analysis.registration.benchmark.deformed import (
    deformed_metrics,
    deformed_table,
    describe_deformed,
    paired_errors,
)


def rows(after: list[float], anatomies: str = "aabbc") -> pd.DataFrame:
    before = np.array([1.0, 2.0, 3.0, 1.0, 4.0])
    found = np.array(after)
    return pd.DataFrame(
        {
            "case": [f"case{number}" for number in range(5)],
            "anatomy": list(anatomies),
            "same_vessel": True,
            "tre_rigid_mm": 0.5,
            "tre_mm": before,
            "tre_covered_mm": before,
            "tre_uncovered_mm": np.nan,
            "tre_deformed_mm": found,
            "tre_deformed_covered_mm": found,
            "tre_deformed_uncovered_mm": np.nan,
            "jacobian_min": [0.9, 0.8, -0.1, 0.7, 0.9],
        }
    )


def test_the_anatomy_is_the_unit() -> None:
    """Means of a, b and c: 1.5, 2 and 4 mm before, 0.75, 1.5 and 2 mm after."""
    pair = paired_errors(rows([0.5, 1.0, 1.0, 2.0, 2.0]), "tre_mm", "tre_deformed_mm")
    assert pair is not None
    assert (pair.cases, pair.better, pair.worse) == (5, 4, 1)
    assert (pair.anatomies_better, pair.change_mm.units) == (3, 3)
    assert (pair.before_mm, pair.after_mm) == pytest.approx((2.5, 4.25 / 3))
    assert pair.change_mm.estimate == pytest.approx(-3.25 / 3)
    assert pair.ratio.estimate == pytest.approx(4.25 / 7.5)
    assert pair.p == pytest.approx(0.25)  # the smallest that three units can have


def test_what_has_no_start_is_counted_and_left_out() -> None:
    cases = rows([0.5, 1.0, 1.0, 2.0, np.inf])
    cases.loc[0, "tre_rigid_mm"] = 5.5
    metrics = deformed_metrics(cases)
    assert metrics["deformed_cases"] == 3 and metrics["deformed_left_out"] == 2
    assert metrics["folding_cases"] == 1
    assert metrics["rigid_covered_mm"] == pytest.approx(2.0) and metrics["deformed_covered_mm"] == 1.25
    assert "rigid_uncovered_mm" not in metrics
    assert list(deformed_table(cases)["rigid and deformed"]["targets"]) == ["all", "covered"]
    said = describe_deformed(cases)
    assert said[-1] == "1 of 5 displacements fold (first: case2)."
    assert said[-2].startswith("2 of 5 cases are not compared")


def test_a_rigid_method_has_none_of_it() -> None:
    cases = rows([1.0] * 5).drop(columns="tre_deformed_mm")
    assert deformed_metrics(cases) == {} and deformed_table(cases) == {} and describe_deformed(cases) == ()
