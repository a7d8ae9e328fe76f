"""The tables: rows by method and piece, with the counts that were put in."""

from __future__ import annotations

import math

import pandas as pd
import pytest
from robustness_rows import FAR, SILENT, binned, row

from experiments.studies.robustness.tables import capture_ranges, tables

CASES = pd.DataFrame(
    [
        *binned("multistart", [4, 4, 3]),
        *binned("single_icp", [4, 2, 0], rmse_mm=0.4, **SILENT),
        *binned("multistart", [4, 4, 4], overlap=0.6, place="end"),
        row("multistart", rotation="flip", angle_from_deg=math.nan, angle_to_deg=math.nan, trial=0),
        *(
            row("multistart", factor="noise_mm", level=1.0, trial=n, tre_mm=tre)
            for n, tre in enumerate((0.3, 0.3, FAR))
        ),
        row("multistart", factor="noise_mm", level=0.0, accepted=False),
    ]
)


def test_success_and_errors_by_method_and_piece_leave_the_factors_out() -> None:
    table = tables(CASES)["robustness"].set_index(["method", "overlap"])
    assert table["trials"].to_dict() == {
        ("multistart", 1.0): 13,
        ("single_icp", 1.0): 12,
        ("multistart", 0.6): 12,
    }
    assert table.loc[("multistart", 1.0), "success_tre_rate"] == pytest.approx(12 / 13)
    assert table.loc[("single_icp", 1.0), "low_rmse_wrong"] == 6
    assert table.loc[("single_icp", 1.0), "success_rate"] == 1
    assert table.loc[("multistart", 1.0), "runtime_s_median"] == pytest.approx(0.3)


def test_verdicts_count_what_was_taken_wrongly_and_left_wrongly() -> None:
    cases = pd.DataFrame([row(), row(tre_mm=FAR), row(accepted=False), row(accepted=False, tre_mm=FAR)])
    (only,) = tables(cases)["verdicts"].to_dict("records")
    assert (only["acceptance_rate"], only["success_tre_accepted_rate"]) == (0.5, 0.5)
    assert (only["accepted_failures"], only["right_not_accepted"]) == (1, 1)
    (interval,) = tables(cases)["tre_intervals"].to_dict("records")
    assert (interval["accepted"], interval["interval_coverage_accepted_rate"]) == (2, 0.5)
    assert interval["tre_high_mm_median"] == 0.6


def test_verdicts_are_shown_for_methods_that_judge_alone() -> None:
    assert set(tables(CASES)["verdicts"]["method"]) == {"multistart"}
    assert "verdicts" not in tables(pd.DataFrame([row(**SILENT)]))


def test_intervals_are_shown_for_methods_that_predict_them_alone() -> None:
    table = tables(CASES)["tre_intervals"]
    assert table[["method", "overlap"]].to_numpy().tolist() == [["multistart", 1.0], ["multistart", 0.6]]


def test_capture_ranges_say_how_many_trials_they_rest_on() -> None:
    few = capture_ranges(CASES[CASES["factor"] == "rotation"])
    assert few["trials_a_bin"].tolist() == [4, 4, 4]
    assert few["capture_range_deg"].isna().all()
    enough = [
        *binned("multistart", [20, 20, 15], 20),
        *binned("single_icp", [20, 10, 0], 20, **SILENT),
        *binned("multistart", [20, 20, 20], 20, overlap=0.6, place="end"),
    ]
    table = capture_ranges(pd.DataFrame(enough))
    assert table[["method", "overlap", "capture_range_deg", "trials_a_bin"]].to_numpy().tolist() == [
        ["multistart", 1.0, 30.0, 20],
        ["single_icp", 1.0, 15.0, 20],
        ["multistart", 0.6, 45.0, 20],
    ]
    assert table["lowest_rate"].tolist() == [0.75, 0.0, 1.0]


def test_levels_of_a_factor_have_a_row_each() -> None:
    table = tables(CASES)["factors"].set_index("level")
    assert table["trials"].to_dict() == {1.0: 3, 0.0: 1}
    assert table.loc[1.0, "success_tre_rate"] == pytest.approx(2 / 3)
    assert table.loc[0.0, "acceptance_rate"] == 0
    assert table.loc[1.0, "tre_mm_median"] == pytest.approx(0.3)


def test_tables_of_what_was_not_run_are_left_out() -> None:
    own = {"robustness", "verdicts", "tre_intervals", "capture_range"}
    assert set(tables(CASES)) == own | {"rotations", "factors", "comparison"}
    assert set(tables(pd.DataFrame([row()]))) == own
    silent = pd.DataFrame([row(tre_low_mm=math.nan, tre_high_mm=math.nan)])
    assert set(tables(silent)) == own - {"tre_intervals"}
    assert set(tables(pd.DataFrame([row(factor="noise_mm", level=0.0)]))) == {"factors"}
