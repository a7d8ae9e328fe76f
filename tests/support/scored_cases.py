"""Per-case tables as the segmentation studies make them, drawn with known differences between models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

DIAGONAL_PX = 100.0


def scored_cases(
    gains: Mapping[str, float],
    *,
    dataset: str = "x",
    simulated: bool = False,
    groups: int = 6,
    cases: int = 4,
    folds: int = 3,
    seeds: Sequence[int] = (0,),
    noise: float = 0.0,
    spacing_mm: float | None = None,
) -> pd.DataFrame:
    """Cases of ``groups`` groups, the last of each without a vessel; a model's DSC is the case's plus its gain."""
    random = np.random.default_rng(7)
    base = random.uniform(0.5, 0.8, (groups, cases))
    rows = []
    for seed in seeds:
        for model, gain in gains.items():
            for (group, case), score in np.ndenumerate(base):
                row = {
                    "case_id": f"{dataset}-{group}-{case}",
                    "group": f"g{group}",
                    "fold": group % folds,
                    "model": model,
                    "dataset": dataset,
                    "seed": seed,
                    "simulated": simulated,
                }
                if case == cases - 1:
                    rows.append({**row, "false_alarm": 0.0})
                    continue
                dsc = score + gain + noise * random.normal()
                distances = {
                    "hd95_px": (1 - dsc) * DIAGONAL_PX,
                    "hd95_unpenalised_px": (1 - dsc) * DIAGONAL_PX,
                }
                if spacing_mm is not None:
                    distances |= {
                        name.replace("_px", "_mm"): value * spacing_mm for name, value in distances.items()
                    }
                rows.append({**row, "dsc": dsc, "missed": 0.0, **distances})
    return pd.DataFrame(rows)
