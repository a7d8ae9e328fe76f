"""Two runs told apart: to the last bit, within a tolerance, NaN as itself, and nothing that differs every time."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd
import pytest

from experiments.analysis.runs.difference import compare_records
from experiments.errors import InputError
from experiments.tracking.run_record import RunRecord

NEXT_UP = float(np.nextafter(0.5, 1.0))


def record(
    points: Sequence[tuple[str, int, float]], cases: pd.DataFrame | None = None, **tags: str
) -> RunRecord:
    history = pd.DataFrame(
        [(*point, number) for number, point in enumerate(points)],
        columns=["metric", "step", "value", "timestamp_ms"],
    )
    return RunRecord("a", "s", "n", "FINISHED", 1, 2, None, tags, {}, "", history, cases)


def test_the_same_numbers_are_equal_and_counted_by_kind() -> None:
    cases = pd.DataFrame({"case_id": ["a", "b"], "dsc": [0.1, math.nan], "runtime_s": [1.0, 2.0]})
    points = [("loss", 0, 1.0), ("loss", 1, 0.5), ("dsc_mean", 0, 0.9), ("training_s", 0, 3.0)]
    found = compare_records(record(points, cases, model="unet"), record(points, cases.copy(), model="unet"))
    assert found.equal
    assert (found.numbers, found.curve_values, found.texts, found.rows, found.columns) == (1, 2, 1, 2, 2)
    assert found.left_out == ("training_s", "runtime_s")


def test_a_single_bit_is_a_difference_unless_a_tolerance_allows_it() -> None:
    one, other = record([("dsc_mean", 0, 0.5)]), record([("dsc_mean", 0, NEXT_UP)])
    (difference,) = compare_records(one, other).different_numbers
    assert (difference.name, difference.original, difference.reproduced) == ("dsc_mean", 0.5, NEXT_UP)
    assert difference.size == NEXT_UP - 0.5
    assert compare_records(one, other, 1e-12).equal


def test_a_tolerance_is_relative_to_numbers_above_one() -> None:
    one, other = record([("n", 0, 1000.0)]), record([("n", 0, 1009.0)])
    assert compare_records(one, other, 0.01).equal
    assert not compare_records(one, other, 0.008).equal
    with pytest.raises(InputError, match="tolerance: expected a number from 0"):
        compare_records(one, other, -1.0)


def test_a_number_that_only_one_run_has_is_a_difference() -> None:
    found = compare_records(
        record([("a", 0, 1.0), ("b_failed", 0, 1.0)]), record([("a", 0, 1.0), ("b", 0, 2.0)])
    )
    assert [(each.name, each.original, each.reproduced) for each in found.different_numbers] == [
        ("b", None, 2.0),
        ("b_failed", 1.0, None),
    ]


def test_a_curve_is_compared_at_every_step_and_the_last_value_logged_counts() -> None:
    one = record([("loss", 0, 9.0), ("loss", 0, 1.0), ("loss", 1, 0.5)])
    other = record([("loss", 0, 1.0), ("loss", 1, 0.25)])
    (difference,) = compare_records(one, other).different_curve_values
    assert (difference.place, difference.size) == ("step 1", 0.25)


def test_results_in_words_are_compared_without_folders_and_without_who_ran_it() -> None:
    one = record([("a", 0, 1.0)], consolidated="ensemble", source="/home/a/model.pt", **{"ctus.pid": "1"})
    other = record([("a", 0, 1.0)], consolidated="average", source=".../model.pt", **{"ctus.pid": "2"})
    (difference,) = compare_records(one, other).different_texts
    assert (difference.name, difference.original, difference.reproduced) == (
        "consolidated",
        "ensemble",
        "average",
    )


def test_a_fold_of_a_sweep_equals_the_same_fold_by_itself() -> None:
    one, other = (record([("a", 0, 1.0)], model="unet", level=level) for level in ("repeat", "result"))
    found = compare_records(one, other)
    assert (found.texts, found.different_texts) == (1, ())


def test_runs_without_anything_to_compare_are_not_equal() -> None:
    assert not compare_records(record([("training_s", 0, 1.0)]), record([("training_s", 0, 1.0)])).equal
