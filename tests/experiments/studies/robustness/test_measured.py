"""Success beside the published sentences: the anatomy is the unit, and one anatomy allows no test."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest
from robustness_rows import FAR, row

from experiments.outcome import JobResult
from experiments.studies.robustness.measured import measured


def result(method: str, right: str, anatomy: str = "aorta", overlap: float = 1.0) -> JobResult:
    rows = [
        row(method, trial=n, anatomy=anatomy, overlap=overlap, rmse_mm=0.4 + 0.1 * n)
        | ({} if one == "+" else {"tre_mm": FAR, "success_tre": False})
        for n, one in enumerate(right)
    ]
    config = {"rigid": {method: {}}, "target": f"{anatomy}.ply", "seed": 0}
    return JobResult(config, {}, pd.DataFrame(rows), Path(), choices={"rigid": method})


def test_trials_of_one_anatomy_have_wilsons_interval_and_no_test() -> None:
    rmse, rate = measured([result("multistart", "+++-"), result("single_icp", "+---")])
    assert (rmse.name, rmse.value, rmse.n, rmse.units) == ("rmse_mm", 0.55, 4, "trials of one anatomy")
    assert (rate.name, rate.value, rate.n) == ("success_rate", 0.75, 4)
    assert (rate.low, rate.high) == pytest.approx((0.3006, 0.9544), abs=1e-3)
    assert rate.said == "single_icp 25%"


def test_several_anatomies_are_the_units_and_are_tested() -> None:
    names = [f"a{number}" for number in range(6)]
    every = [
        *(result("multistart", "++++", name) for name in names),
        *(result("single_icp", "+---", name) for name in names),
    ]
    rmse, rate = measured(every)
    assert (rate.value, rate.n, rate.units, rmse.n) == (1.0, 6, "anatomies", 6)
    assert rate.said == "single_icp 25% (McNemar: p 0.031 (least attainable 0.031))"


def test_overlaps_stand_apart_and_without_multistart_there_is_nothing() -> None:
    whole, part = result("multistart", "++"), result("multistart", "+-", overlap=0.6)
    found = measured([whole, part])
    assert [(one.of, one.value) for one in found if one.name == "success_rate"] == [
        ("multistart, overlap 1", 1.0),
        ("multistart, overlap 0.6", 0.5),
    ]
    assert measured([result("single_icp", "++")]) == []
    assert measured([JobResult({}, {}, None, Path())]) == []
