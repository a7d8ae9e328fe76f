"""One value a unit, by hand, and what becomes of a failure."""

from __future__ import annotations

import math

import pandas as pd
import pytest

from experiments.errors import InputError
from experiments.statistics import by_unit

INF, NAN = math.inf, math.nan


def cases(scores: dict[str, list[float]]) -> pd.DataFrame:
    return pd.DataFrame(
        [{"group": name, "score": value} for name, values in scores.items() for value in values]
    )


def test_a_unit_of_many_cases_counts_as_much_as_one_of_few() -> None:
    found = by_unit(cases({"b": [0.2] * 50, "a": [0.4, 0.8]}), "score")
    assert found.to_dict() == pytest.approx({"a": 0.6, "b": 0.2})
    assert list(found.index) == ["a", "b"]


def test_another_unit_and_the_median() -> None:
    table = cases({"a": [1.0, 2.0, 9.0], "b": [4.0]}).rename(columns={"group": "anatomy"})
    assert by_unit(table, "score", "anatomy", statistic="median").to_dict() == {"a": 2.0, "b": 4.0}


def test_undefined_cases_are_left_out_and_so_are_units_of_nothing_else() -> None:
    found = by_unit(cases({"a": [0.5, NAN, 0.7], "b": [NAN, NAN]}), "score")
    assert found.to_dict() == pytest.approx({"a": 0.6})


def test_a_failure_makes_its_unit_rank_worst() -> None:
    errors = cases({"a": [1.0, INF, 1.0], "b": [900.0], "c": [1.0, NAN]})
    assert by_unit(errors, "score", failed=INF).to_dict() == {"a": INF, "b": 900.0, "c": INF}
    assert by_unit(errors, "score").to_dict() == {"a": INF, "b": 900.0, "c": 1.0}
    assert by_unit(cases({"a": [0.5, NAN]}), "score", failed=0.0).to_dict() == {"a": 0.25}
    assert by_unit(cases({"a": [0.5, NAN]}), "score", failed=-INF).to_dict() == {"a": -INF}


def test_with_the_median_a_unit_fails_when_most_of_its_cases_do() -> None:
    errors = cases({"few": [1.0, 3.0, INF], "most": [1.0, INF, INF], "half": [1.0, INF]})
    found = by_unit(errors, "score", statistic="median")
    assert found.to_dict() == {"few": 3.0, "most": INF, "half": INF}


def test_refuses_what_has_no_unit() -> None:
    table = cases({"a": [1.0]})
    with pytest.raises(InputError, match="cases: expected a column 'dsc', received group, score"):
        by_unit(table, "dsc")
    with pytest.raises(InputError, match="cases: expected a column 'sweep'"):
        by_unit(table, "score", "sweep")
    with pytest.raises(InputError, match="group: expected a name in every case, 1 have none"):
        by_unit(pd.DataFrame({"group": ["a", None], "score": [1.0, 2.0]}), "score")
    with pytest.raises(InputError, match="score: expected failures of one sign, group a has"):
        by_unit(cases({"a": [INF, -INF]}), "score")
    with pytest.raises(InputError, match="statistic: expected mean or median, received 'mode'"):
        by_unit(table, "score", statistic="mode")  # type: ignore[arg-type]


def test_units_are_sorted_and_a_missing_value_of_another_column_does_not_matter() -> None:
    cases = pd.DataFrame({"unit": ["b", "a"], "dsc": [1.0, 2.0], "other": [None, 1.0]})
    found = by_unit(cases, "dsc", "unit")
    assert found.index.tolist() == ["a", "b"] and found.tolist() == [2.0, 1.0]
