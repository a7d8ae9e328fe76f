"""The tables of known cases."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scored_cases import scored_cases

from experiments.analysis.segmentation.comparison import compare_models
from experiments.analysis.segmentation.summary import pooled_metrics
from experiments.analysis.segmentation.tables import intervals, table, tables


def drawn_cases(**columns: object) -> pd.DataFrame:
    base = {
        "case_id": ["a", "b", "c", "d"],
        "group": ["p", "q", "r", "r"],
        "fold": [0, 0, 1, 1],
        "model": ["unet"] * 4,
        "dataset": ["x"] * 4,
        "simulated": [False] * 4,
        "dsc": [0.5, 0.7, 0.0, np.nan],
        "hd95_px": [4.0, 6.0, 50.0, np.nan],
        "hd95_unpenalised_px": [4.0, 6.0, np.nan, np.nan],
        "missed": [0.0, 0.0, 1.0, np.nan],
        "false_alarm": [np.nan, np.nan, np.nan, 1.0],
    }
    return pd.DataFrame({**base, **columns})


def test_table_of_known_numbers() -> None:
    shown = table(drawn_cases()).set_index("fold")
    assert shown.loc["0", "dsc_mean"] == pytest.approx(0.6)
    assert shown.loc["1", "dsc_mean"] == 0.0 and shown.loc["1", "missed_rate"] == 1.0
    assert shown.loc["all", "dsc_mean"] == pytest.approx(0.4)
    assert shown.loc["all", "hd95_px_mean"] == pytest.approx(20.0)
    assert shown.loc["all", "false_alarm_rate"] == 1.0 and np.isnan(shown.loc["0", "false_alarm_rate"])
    assert list(shown["cases"]) == [2, 2, 4]


def test_the_distance_without_penalty_stands_beside_with_its_number() -> None:
    shown = table(drawn_cases()).set_index("fold")
    assert list(shown["hd95_unpenalised_px_n"]) == [2, 0, 2]
    assert shown.loc["all", "hd95_unpenalised_px_mean"] == 5.0
    assert np.isnan(shown.loc["1", "hd95_unpenalised_px_mean"])


def test_several_seeds_are_shown_each_and_together() -> None:
    cases = scored_cases({"unet": 0.0}, seeds=(3, 5))
    cases.loc[cases["seed"] == 5, "dsc"] += 0.1
    shown = table(cases)
    assert list(zip(shown["seed"], shown["fold"], strict=True)) == [
        *(("3", fold) for fold in ("0", "1", "2", "all")),
        *(("5", fold) for fold in ("0", "1", "2", "all")),
        ("all", "all"),
    ]
    by_seed = shown[shown["fold"] == "all"].set_index("seed")["dsc_mean"]
    assert by_seed["5"] - by_seed["3"] == pytest.approx(0.1)
    assert by_seed["all"] == pytest.approx((by_seed["3"] + by_seed["5"]) / 2)
    assert list(shown["cases"])[-1] == 24


def test_one_seed_has_no_column() -> None:
    assert "seed" not in table(scored_cases({"unet": 0.0}))


def test_intervals_are_those_of_the_metrics() -> None:
    cases = pd.concat(
        [
            scored_cases({"unet": 0.0, "other": 0.1}, simulated=True, spacing_mm=0.5),
            scored_cases({"unet": 0.0}, dataset="y", groups=1),
        ],
        ignore_index=True,
    )
    metrics, shown = pooled_metrics(cases), intervals(cases).set_index(["model", "dataset"])
    row = shown.loc[("other", "x (simulated)")]
    for name in (
        "dsc_mean",
        "dsc_ci_low",
        "dsc_ci_high",
        "hd95_mm_ci_low",
        "missed_rate_high",
        "false_alarm_rate",
    ):
        assert row[name] == metrics[f"other/x/{name}"]
    assert row["groups"] == 6 and row["missed_n"] == 18 and row["false_alarm_n"] == 6
    alone = shown.loc[("unet", "y")]
    assert np.isnan(alone["dsc_ci_low"]) and np.isnan(alone["hd95_mm_mean"]) and alone["groups"] == 1
    assert alone["hd95_unpenalised_mm_n"] == 0


def test_what_is_printed() -> None:
    cases = pd.concat(
        [
            scored_cases({"unet": 0.0, "other": 0.1}, simulated=True, spacing_mm=0.5),
            scored_cases({"unet": 0.0}, dataset="y"),
        ],
        ignore_index=True,
    )
    shown = tables(cases, compare_models(cases))
    assert list(shown) == ["segmentation", "comparison", "folds of x (simulated)", "folds of y"]
    words = shown["segmentation"].iloc[0]
    numbers = intervals(cases).iloc[0]
    assert words["dsc"] == (
        f"{numbers['dsc_mean']:.3f} [{numbers['dsc_ci_low']:.3f}, {numbers['dsc_ci_high']:.3f}]"
    )
    assert words["hd95"].endswith(" mm") and words["hd95_unpenalised"].endswith("(n 18)")
    assert words["missed_rate"] == "0.0 [0.0, 17.6] %"
    assert shown["segmentation"]["hd95"].iloc[2].endswith(" px")
    # Where all distances are known in mm, those in px would only widen the table.
    assert not [name for name in shown["folds of x (simulated)"] if "_px" in name]
    assert "hd95_px_mean" in shown["folds of y"] and "hd95_mm_mean" not in shown["folds of y"]


def test_nothing_is_printed_of_a_comparison_that_is_none() -> None:
    cases = scored_cases({"unet": 0.0})
    assert list(tables(cases, compare_models(cases))) == ["segmentation", "folds of x"]


def test_undefined_numbers_are_left_empty() -> None:
    cases = scored_cases({"unet": 0.0})
    shown = tables(cases[cases["dsc"].isna()], pd.DataFrame())["segmentation"].iloc[0]
    assert (shown["dsc"], shown["hd95"], shown["missed_rate"]) == ("", "", "")
    assert shown["false_alarm_rate"] == "0.0 [0.0, 39.0] %"
