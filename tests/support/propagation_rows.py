"""Rows of the study of propagation with a known relation of DSC to the errors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

REFERENCE = "reference"


def propagation_rows(
    dsc: Mapping[str, float], *, vessels: int = 8, folds: int = 1, model: str = "unet", deformed: bool = True
) -> pd.DataFrame:
    """A sweep a vessel; errors grow as DSC falls, and vessels differ in both by more than configurations do."""
    rows: list[dict[str, Any]] = []
    for configuration, mean in dsc.items():
        own = configuration != REFERENCE
        for fold in range(folds if own else 1):
            for number in range(vessels):
                # Hard vessels have a lower DSC, and an error of their own that no mask has a part in.
                score = mean - 0.01 * number - 0.002 * fold if own else 1.0
                tre_mm = 1.0 + 10 * (1 - score) + 0.1 * number
                rows.append(
                    {
                        "configuration": configuration,
                        "model": model if own else "",
                        "fold": fold if own else -1,
                        "sweep": 1000 + number,
                        "vessel": f"random {1000 + number}",
                        "dsc": score,
                        "hd95_mm": 20 * (1 - score),
                        "surface_rmse_mm": 0.2 + 5 * (1 - score),
                        "tre_mm": tre_mm,
                    }
                )
    table = pd.DataFrame(rows).assign(seed=0, phantom="random", frames=50, frames_empty=10, frames_dropped=0)
    return table.assign(
        missed=0,
        false_alarms=np.where(table["configuration"] == REFERENCE, 0, 1),
        surface_hd95_mm=2 * table["surface_rmse_mm"],
        surface_hd95_covered_mm=2 * table["surface_rmse_mm"],
        surface_coverage=0.9,
        surface_error="",
        rmse_mm=0.5,
        deformed_tre_mm=table["tre_mm"] / 2 if deformed else np.nan,
        verdict="accepted",
        error="",
        simulated=True,
        rigid="multistart",
        deformable="cpd" if deformed else "none",
    )


def fail(cases: pd.DataFrame, configuration: str, sweep: int) -> pd.DataFrame:
    """The rows with one sweep of a configuration whose vessel was missed entirely."""
    there = (cases["configuration"] == configuration) & (cases["sweep"] == sweep)
    worst = dict.fromkeys(("surface_rmse_mm", "surface_hd95_mm", "surface_hd95_covered_mm"), np.inf)
    worst |= dict.fromkeys(("rmse_mm", "tre_mm", "deformed_tre_mm"), np.inf)
    changed = cases.copy()
    for name, value in {**worst, "dsc": 0.0, "surface_coverage": 0.0}.items():
        changed.loc[there, name] = value
    changed.loc[there, ["error", "surface_error"]] = "masks: expected a vessel in some of them"
    changed.loc[there, "verdict"] = "failed"
    changed.loc[there, "missed"] = changed.loc[there, "frames"]
    return changed
