"""Residuals of both stages beside the published ones, and what the deformable stage takes off them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from experiments.outcome import JobResult
from experiments.studies.accuracy.measured import measured


def result(phantom: str, deformable_mm: float = 0.5) -> JobResult:
    rows = [
        {
            "phantom": phantom,
            "share": 1.0,
            "sweep": sweep,
            "stage": stage,
            "rigid": "multistart",
            "deformable": "cpd",
        }
        | {"rmse_mm": value, "hd95_mm": 2 * value, "tre_mm": 2.0 if stage == "rigid" else 1.5, "error": ""}
        for sweep in range(6)
        for stage, value in (("rigid", 1.0 + 0.01 * sweep), ("deformable", deformable_mm))
    ]
    return JobResult({"phantoms": [phantom]}, {}, pd.DataFrame(rows), Path(), choices={"phantoms": phantom})


def test_the_artery_has_both_stages_and_others_the_reduction() -> None:
    found = measured([result("artery"), result("vein")])
    assert [(one.name, one.of) for one in found] == [
        ("rmse_mm_artery_rigid", "artery, multistart"),
        ("rmse_mm_artery_deformable", "artery, cpd"),
        ("hd95_mm", "artery, cpd"),
        ("rmse_reduction", "vein, cpd"),
        ("hd95_mm", "vein, cpd"),
    ]
    rigid, deformable, _, reduction, _ = found
    assert rigid.value == pytest.approx(1.025) and deformable.value == 0.5
    assert rigid.low < rigid.value < rigid.high
    assert reduction.value == pytest.approx(1 - 0.5 / 1.025)
    assert "p 0.031 (least attainable 0.031)" in reduction.said
    assert "true error lower in 6 of 6 sweeps" in reduction.said


def test_a_failed_sweep_leaves_no_reduction_that_looks_like_one() -> None:
    broken = result("vein")
    assert broken.cases is not None
    broken.cases.loc[broken.cases.index[-1], ["rmse_mm", "hd95_mm", "tre_mm"]] = np.inf
    reduction = next(one for one in measured([broken]) if one.name == "rmse_reduction")
    assert np.isnan(reduction.value)
    assert measured([JobResult({}, {}, None, Path())]) == []
