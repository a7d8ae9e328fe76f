"""Rows as the robustness study has them, of methods whose success is known by construction."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

GOOD, FAR = 0.3, 40.0


# What a method leaves that neither judges its results nor predicts its error.
SILENT = {"accepted": False, "verdict": "not judged", "tre_low_mm": float("nan"), "tre_high_mm": float("nan")}


def row(method: str = "multistart", **change: Any) -> dict[str, Any]:
    """One trial, right and accepted unless changed; success follows from the errors."""
    found: dict[str, Any] = {
        "anatomy": "aorta",
        "method": method,
        "factor": "rotation",
        "level": float("nan"),
        "rotation": "any",
        "overlap": 1.0,
        "place": "whole",
        "trial": 0,
        "angle_deg": 7.5,
        "angle_from_deg": 0.0,
        "angle_to_deg": 15.0,
        "translation_mm": 5.0,
        "rmse_mm": 0.5,
        "tre_mm": GOOD,
        "accepted": True,
        "tre_low_mm": 0.1,
        "tre_high_mm": 0.6,
        "runtime_s": 0.3,
        "error": "",
    } | change
    found.setdefault(
        "verdict", "failed" if found["error"] else "accepted" if found["accepted"] else "ambiguous"
    )
    found["success"] = found["rmse_mm"] <= 1
    found["success_tre"] = found["tre_mm"] <= 2
    return found


def binned(method: str, right: Sequence[int], trials: int = 4, **change: Any) -> list[dict[str, Any]]:
    """Trials of one method in bins of 15 degrees, the first ``right`` of each bin right and the others far off."""
    return [
        row(
            method,
            trial=number * len(right) + place,
            angle_deg=15.0 * place + 7.5,
            angle_from_deg=15.0 * place,
            angle_to_deg=15.0 * (place + 1),
            tre_mm=GOOD if number < count else FAR,
            **change,
        )
        for place, count in enumerate(right)
        for number in range(trials)
    ]


def many(methods: Sequence[str], trials: int = 25, seed: int = 0) -> pd.DataFrame:
    """A whole study: every method on ten pieces and at every level of two factors, the first as good as perfect."""
    rng = np.random.default_rng(seed)
    rows: list[dict[str, Any]] = []
    pieces = [(1.0, "whole")] + [
        (share, place) for share in (0.8, 0.6, 0.4) for place in ("start", "middle", "end")
    ]
    for rank, method in enumerate(methods):

        def solved(angle_deg: float, overlap: float, rank: int = rank) -> dict[str, float]:
            chance = (
                1.0 - 0.02 * (1 - overlap)
                if rank == 0
                else 1 / (1 + np.exp((angle_deg - 40 - 15 * rank) / 15))
            )
            right = rng.random() < chance * overlap ** (0.2 * rank)
            tre_mm = rng.lognormal(np.log(0.2 if right else 25), 0.4)
            rmse_mm = 0.5 + rng.random() * 0.05 + (0 if right or rng.random() < 0.2 else rng.random() * 5)
            return {
                "tre_mm": tre_mm,
                "rmse_mm": rmse_mm,
                "runtime_s": rng.lognormal(np.log(0.05 * (rank + 1)), 0.3),
            }

        interval = {} if rank == 0 else {"tre_low_mm": np.nan, "tre_high_mm": np.nan}
        for overlap, place in pieces:
            for kind in ("any", "roll", "flip"):
                for number in range(trials * (1 if kind == "flip" else 12)):
                    begin = 15.0 * (number % 12)
                    angle = 180.0 if kind == "flip" else begin + 15 * rng.random()
                    bounds = (np.nan, np.nan) if kind == "flip" else (begin, begin + 15)
                    rows.append(
                        row(method, rotation=kind, overlap=overlap, place=place, trial=number, angle_deg=angle,
                            angle_from_deg=bounds[0], angle_to_deg=bounds[1], **interval, **solved(angle, overlap))
                    )  # fmt: skip
        for factor, levels in {
            "noise_mm": (0, 0.25, 0.5, 1.0),
            "translation_mm": (0, 10, 20, 30, 40, 50),
        }.items():
            for level in levels:
                rows += [
                    row(method, factor=factor, level=float(level), trial=number, **interval,
                        **solved(180 * rng.random(), 1.0))
                    for number in range(trials)
                ]  # fmt: skip
    return pd.DataFrame(rows)
