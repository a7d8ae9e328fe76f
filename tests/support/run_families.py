"""Runs with cases, as a store or an archive would give them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd
import yaml

from experiments.outcome import InputData
from experiments.tracking.run_lookup import Family
from experiments.tracking.run_record import RunRecord

TAGS = {
    "mlflow.source.git.commit": "a" * 40,
    "ctus.git_dirty": "false",
    "ctus.packages": '{"numpy": "2"}',
    "ctus.python": "3",
    "ctus.machine": "m",
    "ctus.kind": "job",
}


def job(
    run_id: str,
    cases: pd.DataFrame | None,
    config: Mapping[str, Any] | None = None,
    metrics: Mapping[str, float] | None = None,
    *,
    experiment: str = "segmentation",
    parent: str | None = None,
    status: str = "FINISHED",
    tags: Mapping[str, str] | None = None,
) -> RunRecord:
    points = [(name, 0, value, 1) for name, value in (metrics or {}).items()]
    history = pd.DataFrame(points, columns=["metric", "step", "value", "timestamp_ms"])
    text = yaml.safe_dump({"study": experiment, "seed": 0, **(config or {})})
    return RunRecord(
        run_id,
        experiment,
        f"run {run_id}",
        status,
        1,
        2,
        parent,
        {**TAGS, **(tags or {})},
        {},
        text,
        history,
        cases,
    )


def alone(run_id: str, cases: pd.DataFrame | None, *args: Any, digest: str = "", **more: Any) -> Family:
    used = (InputData("drawn", digest, "drawn"),) if digest else ()
    return Family(dataclasses.replace(job(run_id, cases, *args, **more), inputs=used))


def sweep(run_id: str, jobs: Sequence[RunRecord]) -> Family:
    return Family(job(run_id, None), tuple(jobs))


def segmented(
    dsc: Sequence[float], model: str = "unet", seed: int = 0, fold: int = 0, first: int = 0
) -> pd.DataFrame:
    """One case in each group, with a DSC each and an HD95 that falls as it rises."""
    numbers = range(first, first + len(dsc))
    return pd.DataFrame(
        {
            "case_id": [f"c{number}" for number in numbers],
            "group": [f"g{number}" for number in numbers],
            "model": model,
            "dataset": "drawn",
            "simulated": False,
            "seed": seed,
            "fold": fold,
            "part": "out_of_fold",
            "dsc": list(dsc),
            "hd95_px": [100.0 * (1 - value) for value in dsc],
            "missed": [float(value == 0) for value in dsc],
            "false_alarm": float("nan"),
        }
    )


def trials(tre_mm: Mapping[str, Sequence[float]], method: str = "single_icp") -> pd.DataFrame:
    """Trials on anatomies, each with a TRE."""
    rows = [
        {
            "anatomy": anatomy,
            "method": method,
            "factor": "rotation",
            "level": 0.0,
            "overlap": 1.0,
            "trial": number,
        }
        | {"tre_mm": value, "rmse_mm": value / 2, "success_tre": value <= 2.0, "success": value <= 2.0}
        | {"accepted": value <= 2.0, "runtime_s": 0.5, "error": "" if value < 1e9 else "lost"}
        for anatomy, values in tre_mm.items()
        for number, value in enumerate(values)
    ]
    return pd.DataFrame(rows)
