"""Sentences that say what was counted, and what may not be concluded."""

from __future__ import annotations

import math

import pandas as pd
import pytest
from robustness_rows import FAR, SILENT, binned, row

from experiments.studies.robustness.findings import describe

NOT_PREDICTED = {"tre_low_mm": math.nan, "tre_high_mm": math.nan}


def test_each_method_and_piece_has_its_sentence_and_what_holds_for_all_comes_last() -> None:
    said = describe(
        pd.DataFrame(
            [
                *binned("multistart", [20, 15], 20, overlap=0.4, place="end"),
                *binned("single_icp", [20, 0], 20, rmse_mm=0.2, overlap=0.4, place="end", **SILENT),
            ]
        )
    )
    assert said[0].startswith(
        "multistart at overlap 0.4 (end): 35 of 40 trials within 2 mm of the truth (88%"
    )
    assert said[1].startswith("single_icp at overlap 0.4 (end): 20 of 40")
    assert said[2] == (
        "multistart accepted 40 of its 40 results, of which 35 of 40 (87.5%, Wilson 95 % interval 73.9% to 94.5%) lie "
        "within 2 mm; its predicted 90 % intervals hold the true error in 35 of 40 (87.5%, Wilson 95 % interval 73.9% "
        "to 94.5%) of them."
    )
    assert said[3] == "single_icp: its results are not judged."
    assert said[4].startswith("multistart captures rotations up to 15 degrees (at least 95% success")
    assert "in these trials; 20 trials a bin at least" in said[5]
    assert said[6].startswith("RMSE hides 25 of 80 trials")
    assert said[7].startswith("All trials are on one anatomy: tests across anatomies are not possible")


def test_failures_and_factors_are_said() -> None:
    said = describe(
        pd.DataFrame(
            [
                row(
                    tre_mm=math.inf,
                    rmse_mm=math.inf,
                    error="RuntimeError: lost",
                    accepted=False,
                    **NOT_PREDICTED,
                ),
                row(factor="noise_mm", level=0.0, **NOT_PREDICTED),
                row(factor="noise_mm", level=0.5, tre_mm=FAR, rmse_mm=3.0, **NOT_PREDICTED),
            ]
        )
    )
    assert said[1] == (
        "multistart at overlap 1 gave no result in 1 of 1 trial, which count as failed (first: RuntimeError: lost)."
    )
    assert said[2] == "multistart by noise_mm, trials within 2 mm: 0: 1 of 1, 0.5: 0 of 1."
    # One of the two that were accepted is right; no error was predicted, so nothing is said of intervals.
    assert said[3].startswith("multistart accepted 2 of its 3 results, of which 1 of 2 (50.0%")
    assert "intervals hold" not in said[3]
    assert not any("anatomy" in sentence for sentence in said)


def test_several_anatomies_are_said_to_be_pooled() -> None:
    said = describe(pd.DataFrame([row("a", anatomy=name) for name in ("first", "second")]))
    assert said[-1].startswith("Wilson intervals pool the trials of 2 anatomies")


@pytest.mark.parametrize("trials", [1, 4, 9])
def test_too_few_trials_a_bin_show_no_capture_range(trials: int) -> None:
    said = describe(pd.DataFrame(binned("multistart", [trials, trials, 0], trials)))
    assert not any("captures" in sentence for sentence in said)
    count = "1 trial" if trials == 1 else f"{trials} trials"
    assert f"No capture range: a bin of angles has {count}, at least 10 are needed for a rate of 95%." in said


def test_one_trial_is_not_called_trials() -> None:
    said = describe(pd.DataFrame([row()]))
    assert said[0].startswith("multistart at overlap 1: 1 of 1 trial within 2 mm")
