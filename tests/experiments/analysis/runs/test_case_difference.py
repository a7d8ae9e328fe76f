"""Tables of cases told apart row by row and column by column."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd

from experiments.analysis.runs.case_difference import compare_cases, size_of

CASES = pd.DataFrame(
    {"case_id": ["a", "b", "c"], "dsc": [0.1, 0.2, math.nan], "hd95_mm": [1.0, math.inf, 3.0], "n": [1, 2, 3]}
)


def test_equal_tables_have_no_difference_with_nan_and_infinity_as_themselves() -> None:
    found = compare_cases(CASES, CASES.copy())
    assert (found.rows, found.columns, found.different_columns, found.different_rows) == (3, 4, (), 0)
    assert compare_cases(None, None).rows == 0


def test_the_largest_difference_of_a_column_is_named_with_its_case() -> None:
    other = CASES.assign(dsc=[0.125, 0.1, math.nan], n=[1, 2, 4])
    dsc, count = compare_cases(CASES, other).different_columns
    assert (dsc.name, dsc.place, dsc.original, dsc.reproduced, dsc.rows) == ("dsc", "row 1 (b)", 0.2, 0.1, 2)
    assert math.isclose(dsc.size, 0.1)
    assert (count.name, count.place, count.size, count.rows) == ("n", "row 2 (c)", 1.0, 1)
    assert compare_cases(CASES, other).different_rows == 3


def test_a_failure_on_one_side_is_infinitely_far() -> None:
    (found,) = compare_cases(CASES, CASES.assign(dsc=[0.1, 0.2, 0.3])).different_columns
    assert (found.place, found.size) == ("row 2 (c)", math.inf)
    (found,) = compare_cases(CASES, CASES.assign(hd95_mm=[1.0, 2.0, 3.0])).different_columns
    assert found.size == math.inf


def test_texts_and_lists_differ_without_a_size() -> None:
    one = pd.DataFrame({"case_id": ["a", None], "pose": [np.eye(2), np.eye(2)], "why": [None, "lost"]})
    assert not compare_cases(one, one.copy()).different_columns
    other = one.assign(pose=[np.eye(2), 2 * np.eye(2)], why=[math.nan, "found"])
    pose, why = compare_cases(one, other).different_columns
    assert (pose.name, why.name, why.original, why.reproduced) == ("pose", "why", "lost", "found")
    assert math.isnan(pose.size)


def test_tables_of_other_lengths_or_columns_are_not_taken_for_equal() -> None:
    (rows,) = compare_cases(CASES, CASES.iloc[:2]).different_columns
    assert (rows.name, rows.original, rows.reproduced, rows.size) == ("rows", 3, 2, 1.0)
    (rows,) = compare_cases(None, CASES).different_columns
    assert (rows.original, rows.reproduced) == (0, 3)
    lost = compare_cases(CASES, CASES.drop(columns="dsc"))
    assert [each.name for each in lost.different_columns] == ["dsc"]
    assert lost.different_rows == 3


def test_runtimes_are_left_out_and_named() -> None:
    found = compare_cases(CASES.assign(runtime_s=1.0), CASES.assign(runtime_s=2.0))
    assert (found.left_out, found.different_columns) == (("runtime_s",), ())


def test_a_size_is_zero_within_the_tolerance_only() -> None:
    assert size_of(1.0, 1.0 + 1e-9, 1e-8) == 0.0
    assert size_of(1.0, 1.5, 0.1) == 0.5
    assert size_of(math.nan, math.nan, 0.0) == 0.0
