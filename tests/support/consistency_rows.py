"""Rows as the consistency study has them, of sweeps whose distances are known."""

from __future__ import annotations

import itertools

import numpy as np
import pandas as pd


def cases(apart_mm: np.ndarray, phantom: str = "vein") -> pd.DataFrame:
    """Rows of sweeps whose pairs are ``apart_mm`` (n, n) from each other and 0.5 mm from the truth."""
    rows = []
    for first, second in itertools.combinations(range(len(apart_mm)), 2):
        value = apart_mm[first, second]
        names = ("msd_mm", "hd95_mm", "msd_covered_mm", "hd95_covered_mm", "msd_tissue_mm", "hd95_tissue_mm")
        rows.append({"kind": "pair", "first": first, "second": second} | dict.fromkeys(names, value))
    truth = {
        "msd_covered_mm": 0.5, "hd95_covered_mm": 0.9, "bias_mm": -0.1, "covered_second": 0.8, "runtime_s": 2.0,
        "frames_rejected": 0.0, "pieces_left_out": 0.0, "gap_share": 0.0,
    }  # fmt: skip
    rows += [{"kind": "truth", "first": number, "second": -1} | truth for number in range(len(apart_mm))]
    rows.append({"kind": "common", "first": -1, "second": -1, "msd_covered_mm": 0.4})
    return pd.DataFrame(rows).assign(phantom=phantom, simulated=True, error="")
