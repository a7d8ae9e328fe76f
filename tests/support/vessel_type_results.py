"""Results of the study of vessel types with known gains."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
from scored_cases import scored_cases

from experiments.outcome import JobResult

# Arteries are easier; aggregation helps them and harms veins.
GAINS = {
    ("artery", "carotid"): 0.10,
    ("artery", "femoral"): 0.10,
    ("artery", "aggregated"): 0.15,
    ("vein", "carotid"): -0.10,
    ("vein", "femoral"): -0.10,
    ("vein", "aggregated"): -0.20,
}


def cases(vessel: str, trained: str, data: str = "") -> pd.DataFrame:
    districts = ("carotid", "femoral") if trained == "aggregated" else (trained,)
    parts = [
        scored_cases({"unet": GAINS[vessel, trained]}, dataset=district, groups=10).assign(district=district)
        for district in districts
    ]
    # Names of cases hold the district, as sequences of different districts do; groups are those of volunteers.
    return pd.concat(parts, ignore_index=True).assign(
        vessel=vessel, trained_on=trained, dataset=f"musv_{vessel}_{trained}", data=data, part="out_of_fold"
    )


def results(data: str = "", simulated: bool = False, trained: tuple[str, ...] = ()) -> list[JobResult]:
    return [
        JobResult(
            {"vessels": [vessel], "districts": [place]},
            {},
            cases(vessel, place, data).assign(simulated=simulated),
            Path(),
        )
        for vessel, place in GAINS
        if not trained or place in trained
    ]
