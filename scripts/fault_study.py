"""The study that the campaign of faults runs where a fault does not depend on what is computed.

Its numbers follow from the seed alone, its files are of several kinds, and it takes a known time. The campaign
registers it as a plugin (``fault_processes.plugin``), so that workers in processes of their own find it too.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from experiments.outcome import InputData, JobResult, Outcome, Progress

CONFIGURATION = """# @package _global_
# Numbers of a seed, slowly, for the campaign of faults.
parts: [1, 2, 3, 4]
part: null
seconds: 0.4
size_kb: 20
"""


def jobs(config: Mapping[str, Any]) -> list[dict[str, Any]]:
    """One job a part."""
    return [{"part": part} for part in config["parts"]]


def run(
    *, part: int, seconds: float, size_kb: int, seed: int, workspace: Path, progress: Progress
) -> Outcome:
    """Draw a table, wait, and leave it with a file of ``size_kb``."""
    chance = np.random.default_rng([seed, part])
    table = pd.DataFrame({"case_id": [f"{part}-{row}" for row in range(20)], "value": chance.normal(size=20)})
    for _ in progress.track(range(4), "waiting"):
        time.sleep(seconds / 4)
    (workspace / "numbers.bin").write_bytes(chance.bytes(1000 * size_kb))
    return Outcome(
        metrics={"value_mean": float(table["value"].mean()), "part_used": float(part)},
        cases=table,
        history=tuple({"train_loss": float(value)} for value in chance.random(5)),
        inputs=(InputData("numbers", "abc", "memory"),),
        tables={"values": table.head(3)},
    )


def summarise(results: list[JobResult]) -> Outcome:
    """A row a part."""
    rows = [{"part": each.config["part"], "value_mean": each.metrics["value_mean"]} for each in results]
    return Outcome(metrics={"parts": float(len(rows))}, cases=pd.DataFrame(rows), findings=("all counted",))
