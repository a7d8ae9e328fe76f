"""Metrics and pooled rows of the study of propagation."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from propagation_rows import fail, propagation_rows

from experiments.outcome import JobResult
from experiments.studies.propagation.report import metrics, pooled, shown


def result(cases: pd.DataFrame, choices: dict[str, str] | None = None, **config: Any) -> JobResult:
    name = str(cases["configuration"].iloc[0])
    settings = {"configurations": [name], "fold": 0, **config}
    return JobResult(settings, {}, cases, Path("nowhere"), choices=choices or {})


def test_metrics_of_a_configuration() -> None:
    cases = propagation_rows({"full": 0.8}, vessels=4)
    found = metrics(cases)
    assert found["dsc_mean"] == pytest.approx(0.785)
    assert found["tre_mm_median"] == pytest.approx(cases["tre_mm"].median())
    assert found["missed_rate"] == 0.0
    assert found["false_alarm_rate"] == pytest.approx(0.1)
    assert found["success_tre_rate"] == pytest.approx((cases["deformed_tre_mm"] <= 2).mean())
    assert (found["surfaces_failed"], found["registrations_failed"]) == (0, 0)
    assert "false_alarm_rate" not in metrics(cases.assign(frames_empty=0, false_alarms=0))


def test_a_failure_is_counted_and_makes_no_mean() -> None:
    found = metrics(fail(propagation_rows({"full": 0.8}, vessels=4), "full", 1002))
    assert np.isinf(found["tre_mm_mean"])
    assert np.isfinite(found["tre_mm_median"])
    assert found["registrations_failed"] == found["surfaces_failed"] == 1
    assert found["missed_rate"] == pytest.approx(0.25)
    assert found["success_tre_rate"] <= 0.75


def test_reference_rows_count_once_and_networks_of_several_settings_have_names() -> None:
    results = []
    for width in ("8", "16"):
        choices = {"model.width": width}
        results += [
            result(propagation_rows({name: dsc}, vessels=2), choices)
            for name, dsc in (("reference", 1.0), ("full", 0.8))
        ]
    cases = pooled(results)
    assert cases is not None
    assert cases.groupby(["configuration", "model"]).size().to_dict() == {
        ("reference", ""): 2, ("full", "unet model.width=8"): 2, ("full", "unet model.width=16"): 2,
    }  # fmt: skip
    assert pooled([]) is None


def test_the_summary_has_metrics_of_each_configuration_and_of_the_correlation(tmp_path: Path) -> None:
    outcome = shown(
        propagation_rows({"reference": 1.0, "full": 0.8, "pruned": 0.9}), notes=["Simulated: all."]
    )
    assert outcome.metrics["reference/dsc_mean"] == 1.0
    assert outcome.metrics["full/tre_mm_median"] > outcome.metrics["pruned/tre_mm_median"]
    assert outcome.metrics["spearman_dsc_surface_rmse_mm"] == pytest.approx(-1.0)
    assert outcome.metrics["spearman_dsc_tre_mm_ci_low"] <= outcome.metrics["spearman_dsc_tre_mm_ci_high"]
    assert set(outcome.figures) == {"propagation"}
    assert outcome.findings[0] == "Simulated: all."
    assert len(outcome.findings) == 4
    outcome.files["correlations.csv"](tmp_path / "correlations.csv")
    assert set(pd.read_csv(tmp_path / "correlations.csv")["over"]) == {"all", "same sweep", "full", "pruned"}
