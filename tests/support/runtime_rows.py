"""Rows as the runtime study has them, of known times."""

from __future__ import annotations

import pandas as pd

SECONDS = {
    "acquisition": (10.0, 10.0, 10.0),
    "preprocessing": (1.0, 1.5, 1.0),
    "segmentation": (4.0, 3.5, 6.0),
    "reconstruction": (1.0, 1.0, 2.0),
    "rigid": (0.5, 0.5, 0.5),
}


def costs(seconds: dict[str, tuple[float, ...]] = SECONDS, phantom: str = "vein") -> pd.DataFrame:
    return pd.DataFrame(
        {
            "phantom": phantom,
            "repeat": repeat,
            "stage": stage,
            "seconds": taken[repeat],
            "peak_memory_mb": float("nan") if stage == "acquisition" else 500.0 + len(stage),
            "modelled": stage == "acquisition",
            "error": "",
            "frames": 100,
            "tre_mm": 0.4,
            "simulated": True,
        }
        for repeat in range(3)
        for stage, taken in seconds.items()
    )
