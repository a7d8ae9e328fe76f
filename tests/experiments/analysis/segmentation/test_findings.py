"""The sentences of known cases."""

from __future__ import annotations

import numpy as np
import pandas as pd
from scored_cases import scored_cases

from experiments.analysis.segmentation.findings import describe
from experiments.analysis.segmentation.summary import pooled_metrics


def test_sentence_of_known_numbers() -> None:
    cases = pd.DataFrame(
        {
            "case_id": list("abcd"),
            "group": list("pppp"),
            "fold": [0, 0, 1, 1],
            "model": "unet",
            "dataset": "x",
            "simulated": False,
            "dsc": [0.5, 0.7, 0.0, np.nan],
            "hd95_px": [4.0, 6.0, 50.0, np.nan],
            "missed": [0.0, 0.0, 1.0, np.nan],
            "false_alarm": [np.nan, np.nan, np.nan, 1.0],
        }
    )
    assert describe(cases) == (
        "unet on x, fold 0, 1: mean DSC 0.400 and mean hd95_px 20.00 over 3 unseen cases with a vessel in 1 groups, "
        "1 of them missed; 1 false alarms in 1 without one.",
    )


def test_the_interval_is_that_of_the_metrics_and_few_groups_are_told() -> None:
    cases = scored_cases({"unet": 0.0}, simulated=True)
    metrics, (sentence,) = pooled_metrics(cases), describe(cases)
    low, high = metrics["dsc_ci_low"], metrics["dsc_ci_high"]
    assert sentence.startswith("unet on x (simulated), fold 0, 1, 2: mean DSC")
    assert f"(95 % interval {low:.3f} to {high:.3f})" in sentence and "too narrow" not in sentence
    (few,) = describe(scored_cases({"unet": 0.0}, groups=4))
    assert few.endswith("From fewer than 5 groups, such intervals are too narrow.")


def test_seeds_are_named() -> None:
    (sentence,) = describe(scored_cases({"unet": 0.0}, seeds=(0, 1, 2)))
    assert "fold 0, 1, 2, 3 seeds: mean DSC" in sentence
    assert "over 54 predictions for unseen cases with a vessel in 6 groups" in sentence


def test_cases_without_any_vessel() -> None:
    cases = scored_cases({"unet": 0.0})
    assert describe(cases[cases["dsc"].isna()]) == (
        "unet on x, fold 0, 1, 2: no case with a vessel; 0 false alarms in 6 without one.",
    )
