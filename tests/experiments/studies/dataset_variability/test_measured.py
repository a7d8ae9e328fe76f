"""Known scores of configurations, beside the published values."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest
from scored_cases import scored_cases

from experiments.outcome import JobResult
from experiments.studies.dataset_variability.measured import measured

GAINS = {"single_session": 0.1, "full": -0.1, "pruned": 0.0}


def results(model: str = "unet3plus") -> list[JobResult]:
    found = []
    for name, gain in GAINS.items():
        parts = [
            scored_cases({model: gain}, groups=8, folds=1).assign(part=part, configuration=name)
            for part in ("held_out", "out_of_fold")
        ]
        cases = pd.concat(parts, ignore_index=True).assign(dataset=f"san_raffaele_{name}")
        found.append(JobResult({"configurations": [name]}, {}, cases, Path()))
    return found


def test_configurations_are_measured_on_both_kinds_of_cases_and_compared_on_the_common_ones() -> None:
    found = measured(results())
    assert [(one.name, one.of) for one in found[:4]] == [
        ("dsc_single_session", "unet3plus trained on single_session, common test subjects"),
        ("dsc_full", "unet3plus trained on full, common test subjects"),
        ("dsc_single_session", "unet3plus trained on single_session, own unseen cases"),
        ("dsc_full", "unet3plus trained on full, own unseen cases"),
    ]
    assert found[0].value - found[1].value == pytest.approx(0.2)
    recovered = next(one for one in found if one.name == "dsc_pruned")
    assert recovered.of.startswith("full minus pruned") and recovered.value == pytest.approx(-0.1)
    distance = next(one for one in found if one.name == "hd95")
    assert distance.of.startswith("single_session minus full") and distance.value == pytest.approx(-20.0)


def test_the_lowest_value_was_published_of_one_network_alone() -> None:
    assert "dsc_full" not in {one.name for one in measured(results("unet"))}
