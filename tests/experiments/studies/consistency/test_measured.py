"""Distances between sweeps beside the published ones: known medians of phantoms, and their order."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from consistency_rows import cases

from experiments.outcome import JobResult
from experiments.reporting.measured import SIMULATED
from experiments.studies.consistency.measured import measured


def result(apart_mm: float, phantom: str) -> JobResult:
    return JobResult({}, {}, cases(np.full((4, 4), apart_mm), phantom), Path())


def test_each_phantom_has_its_median_and_the_artery_is_set_against_the_largest_other() -> None:
    found = measured([result(0.3, "vein"), result(0.5, "artery"), result(0.4, "artificial")])
    assert [(one.name, one.of, one.value, one.n) for one in found[:3]] == [
        ("hd95_mm_median", "vein", 0.3, 4),
        ("hd95_mm_median", "artery", 0.5, 4),
        ("hd95_mm_median", "artificial", 0.4, 4),
    ]
    assert found[3].name == "hd95_mm_artery" and found[3].value == pytest.approx(0.1)
    assert {one.not_comparable for one in found} == {SIMULATED}


def test_one_phantom_alone_is_compared_with_none() -> None:
    assert [one.name for one in measured([result(0.5, "artery")])] == ["hd95_mm_median"]
    assert measured([JobResult({}, {}, None, Path())]) == []
