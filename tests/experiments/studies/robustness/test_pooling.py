"""Trials of all jobs pooled: nothing under one name that is not the same, nothing counted as a pair that is none."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd
from robustness_rows import row

from experiments.outcome import JobResult
from experiments.studies.robustness.comparison import comparison
from experiments.studies.robustness.metrics import PROBLEM
from experiments.studies.robustness.pooling import pooled


def job(method: str, choices: dict[str, str] | None = None, **config: Any) -> JobResult:
    cases = pd.DataFrame([row(method, anatomy="surface", trial=number) for number in range(3)])
    return JobResult(config, {}, cases, Path(), choices=choices or {})


def test_surfaces_whose_files_have_one_name_are_two_anatomies() -> None:
    targets = ("/d/a/surface.ply", "/d/b/surface.ply")
    cases = pooled(
        [job(method, target=target) for target in targets for method in ("multistart", "single_icp")]
    )
    assert set(cases["anatomy"]) == {"a/surface.ply", "b/surface.ply"}
    assert not cases.duplicated([*PROBLEM, "method"]).any()
    assert set(pooled([job("multistart", target=targets[0])])["anatomy"]) == {"surface"}


def test_one_method_with_two_settings_is_two_methods() -> None:
    cases = pooled([job("multistart", {"rigid.multistart.starts.rolls": rolls}) for rolls in ("12", "24")])
    assert list(dict.fromkeys(cases["method"])) == [
        "multistart rigid.multistart.starts.rolls=12",
        "multistart rigid.multistart.starts.rolls=24",
    ]


def test_trials_of_two_seeds_are_more_trials_and_pair_only_with_their_own() -> None:
    jobs = [
        job(method, {"seed": str(seed)}, seed=seed)
        for seed in (0, 7)
        for method in ("multistart", "single_icp")
    ]
    cases = pooled(jobs)
    assert set(cases["method"]) == {"multistart", "single_icp"}
    assert not cases.duplicated([*PROBLEM, "method"]).any()
    assert len(cases[cases["method"] == "multistart"]) == 6
    assert set(comparison(cases)["units"]) == {6}
