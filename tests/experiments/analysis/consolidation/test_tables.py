"""Tables over jobs, on rows whose numbers are known."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest

from experiments.analysis.consolidation.candidates import BEST_FOLD, ENSEMBLE, MEAN_FOLD, UNIFORM
from experiments.analysis.consolidation.findings import describe_ablation
from experiments.analysis.consolidation.rows import best_fold_rows
from experiments.analysis.consolidation.tables import (
    ablation_table,
    barrier_table,
    candidates_table,
    reliability,
)
from experiments.analysis.consolidation.thresholds import STEPS

ABOUT = {"network": "unet", "dataset": "x", "simulated": False, "outer_fold": -1}


def case(model: str, group: int, dsc: float, *, seed: int = 0, fold: int = -1, **more: Any) -> dict[str, Any]:
    row = {"kind": "case", "model": model, "seed": seed, "fold": fold, "part": "test", "step": "raw 0.5"}
    return (
        row
        | {
            "group": f"g{group}",
            "case_id": f"c{group}",
            "dsc": dsc,
            "hd95_px": 10 * (1 - dsc),
            "missed": 0.0,
            "false_alarm": np.nan,
        }
        | more
    )


def table(rows: list[dict[str, Any]]) -> pd.DataFrame:
    return pd.DataFrame([{**row, **ABOUT} for row in rows])


def costs(model: str, megabytes: float) -> dict[str, Any]:
    return {
        "kind": "candidate",
        "model": model,
        "seed": 0,
        "fold": -1,
        "megabytes": megabytes,
        "seconds_per_frame": 0.1,
    }


def trust(
    model: str, group: str, bin_: int, pixels: int, probability: float, vessel: int, seed: int = 0
) -> dict[str, Any]:
    return {
        **{"kind": "reliability", "model": model, "seed": seed, "fold": -1, "calibration": "none"},
        **{"region": "everywhere", "group": group, "bin": bin_, "pixels": pixels},
        **{"probability_sum": probability, "vessel_pixels": vessel, "nll_sum": 1.0, "brier_sum": 2.0},
    }


def test_the_mean_fold_is_the_mean_of_the_folds_and_differences_are_of_the_same_cases() -> None:
    rows = [case(MEAN_FOLD, group, 0.5 + 0.1 * fold, fold=fold) for group in range(6) for fold in (0, 1)]
    rows += [case(ENSEMBLE, group, 0.7 + 0.01 * group) for group in range(6)]
    rows += [
        case(MEAN_FOLD, 9, np.nan, fold=0, missed=np.nan, false_alarm=1.0),
        costs(ENSEMBLE, 24.0),
        costs(MEAN_FOLD, 8.0),
    ]
    rows += [case(MEAN_FOLD, 9, np.nan, fold=1, missed=np.nan, false_alarm=0.0)]
    rows += [case(ENSEMBLE, 9, np.nan, missed=np.nan, false_alarm=1.0), trust(ENSEMBLE, "g0", 3, 10, 2.0, 3)]
    found = candidates_table(table(rows)).set_index("model")
    assert found.loc[MEAN_FOLD, "dsc_mean"] == pytest.approx(0.55)
    assert found.loc[MEAN_FOLD, "difference"] == pytest.approx(0.55 - 0.725)
    assert found.loc[MEAN_FOLD, "difference_ci_low"] < -0.175 < found.loc[MEAN_FOLD, "difference_ci_high"]
    assert found.loc[MEAN_FOLD, "false_alarms"] == 0.5 and found.loc[ENSEMBLE, "false_alarms"] == 1.0
    assert found.loc[ENSEMBLE, "megabytes"] == 24.0 and found.loc[ENSEMBLE, "empty"] == 1
    assert found.loc[ENSEMBLE, "ece"] == pytest.approx(0.1) and np.isnan(found.loc[MEAN_FOLD, "ece"])


def test_the_best_fold_is_chosen_by_groups_on_selection_and_takes_its_own_rows() -> None:
    rows = [case(MEAN_FOLD, 0, 0.9, fold=0, part="selection", case_id=str(n)) for n in range(5)]
    rows += [case(MEAN_FOLD, 1, 0.1, fold=0, part="selection")]
    rows += [case(MEAN_FOLD, group, 0.6, fold=1, part="selection") for group in (0, 1)]
    rows += [case(MEAN_FOLD, 7, 1.0, fold=0)]
    best, copies = best_fold_rows(rows)
    # By cases fold 0 would be ahead (0.77), by groups fold 1 is; test rows have no say.
    assert best == 1 and {row["model"] for row in copies} == {BEST_FOLD} and len(copies) == 2


def test_zero_gains_are_zero_and_said_so() -> None:
    rows = [
        case(ENSEMBLE, group, dsc, step=step)
        for group in range(6)
        for step, dsc in zip(STEPS, (0.6, 0.6, 0.65, 0.65, 0.64), strict=True)
    ]
    found = ablation_table(table(rows), (ENSEMBLE, UNIFORM))
    assert found["gain"].tolist()[1:] == pytest.approx([0.0, 0.05, 0.0, -0.01])
    assert found["gain_ci_low"].tolist()[1] == 0.0
    (sentence,) = describe_ablation(found)
    assert (
        "calibrated 0.000 (+0.000 to +0.000), threshold +0.050" in sentence
        and "morphology -0.010" in sentence
    )


def test_calibration_errors_of_two_seeds_are_averaged_not_cancelled() -> None:
    rows = [
        trust(ENSEMBLE, group, 3, 100, 20.0 + 10 * sign, 20, seed)
        for seed, sign in enumerate((1, -1))
        for group in "ab"
    ]
    found = reliability(table(rows))[ENSEMBLE, "none", "everywhere"]
    assert found["ece"] == pytest.approx(0.1)
    assert found["ece_ci_low"] == pytest.approx(0.1) and found["ece_ci_high"] == pytest.approx(0.1)
    assert found["nll"] == pytest.approx(4 / 400)


def test_a_barrier_is_measured_from_the_line_between_the_ends() -> None:
    line = {"kind": "barrier", "first": "fold 0", "second": "fold 1", "seed": 0}
    points = [(0.0, 0.2, 0.8), (0.5, 0.9, 0.3), (1.0, 0.4, 0.6)]
    rows = [{**line, "alpha": alpha, "loss": loss, "dsc": dsc} for alpha, loss, dsc in points]
    (found,) = barrier_table(table(rows)).to_dict("records")
    assert found["pair"] == "fold 0, fold 1" and found["jobs"] == 1
    assert found["loss_barrier_mean"] == pytest.approx(0.6) and found["dsc_barrier_mean"] == pytest.approx(
        0.4
    )
