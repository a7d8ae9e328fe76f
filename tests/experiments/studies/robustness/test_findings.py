"""Sentences that say what was counted, and what may not be concluded."""

from __future__ import annotations

import math

import pandas as pd
from robustness_rows import FAR, binned, row

from experiments.studies.robustness.findings import describe

NOT_PREDICTED = {"tre_low_mm": math.nan, "tre_high_mm": math.nan}


def test_each_method_and_piece_has_its_sentence_and_what_holds_for_all_comes_last() -> None:
    said = describe(
        pd.DataFrame(
            [
                *binned("multistart", [4, 3], overlap=0.4, place="end"),
                *binned("single_icp", [4, 0], rmse_mm=0.2, overlap=0.4, place="end", **NOT_PREDICTED),
            ]
        )
    )
    assert said[0].startswith("multistart at overlap 0.4 (end): 7 of 8 trials within 2 mm of the truth (88%")
    assert said[1].startswith("single_icp at overlap 0.4 (end): 4 of 8")
    assert said[2] == (
        "multistart accepted 100.0% of its answers, of which 87.5% lie within 2 mm; its predicted 90 % intervals hold "
        "the true error in 87.5% of them."
    )
    assert said[3].startswith(
        "multistart captures rotations up to 15 degrees on its worst piece and 15 on its best"
    )
    assert "4 trials a bin at least" in said[4]
    assert said[5].startswith("RMSE hides 5 of 16 trials")
    assert said[6].startswith("All trials are on one anatomy: tests across anatomies are not possible")


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
        "multistart at overlap 1 gave no answer in 1 of 1 trials, which count as failed (first: RuntimeError: lost)."
    )
    assert said[2] == "multistart by noise_mm, trials within 2 mm: 0: 1 of 1, 0.5: 0 of 1."
    assert not any("accepted" in sentence for sentence in said)
    assert not any("anatomy" in sentence for sentence in said)


def test_several_anatomies_are_said_to_be_pooled() -> None:
    said = describe(pd.DataFrame([row("a", anatomy=name) for name in ("first", "second")]))
    assert said[-1].startswith("Wilson intervals pool the trials of 2 anatomies")
