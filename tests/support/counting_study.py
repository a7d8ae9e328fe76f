"""The study that the tests of the sweep runner run: it counts, and fails or refuses where it is told to."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from experiments.errors import InputError
from experiments.outcome import InputData, JobResult, Outcome, Progress

calls: list[int] = []


def jobs(config: Mapping[str, Any]) -> list[dict[str, Any]]:
    return [{"part": part} for part in config["parts"]]


def check(*, needed: str) -> None:
    if needed != "here":
        raise InputError(f"needed: expected 'here', received {needed!r}")


def run(
    *,
    part: int,
    fail_on: list[int],
    refuse_on: list[int],
    seed: int,
    workspace: Path,
    progress: Progress,
    data: Path | None = None,
) -> Outcome:
    calls.append(part)
    (workspace / "half.txt").write_text(f"part {part}\n")
    if part in fail_on:
        raise RuntimeError(f"part {part} broke")
    if part in refuse_on:
        raise InputError(f"part: expected another one, received {part}")
    table = pd.DataFrame(
        {"case_id": [f"{part}-{i}" for i in progress.track(range(3), "counting")], "value": [1.0, 2.0, part]}
    )
    return Outcome(
        metrics={"value_mean": float(table["value"].mean()), "seed_used": seed, "broken": float("nan")},
        cases=table,
        history=({"loss": 1.0}, {"loss": 0.5}),
        inputs=(InputData("numbers", "abc", "memory"),),
        tables={"one job": table},
    )


def summarise(results: list[JobResult]) -> Outcome:
    rows = pd.DataFrame(
        {"part": [r.config["part"] for r in results], "value": [r.metrics["value_mean"] for r in results]}
    )
    return Outcome(metrics={"parts": len(rows)}, cases=rows, tables={"parts": rows}, findings=("counted",))
