"""Cases pooled over jobs: nothing mixed that is not the same, nothing counted twice."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scored_cases import scored_cases

from experiments.errors import InputError
from experiments.outcome import CellResult
from experiments.studies.segmentation_cases import distance, groups, once_each, pool


def job(config: dict[str, Any], model: str = "unet", dataset: str = "x") -> CellResult:
    cases = scored_cases({model: 0.0}, dataset=dataset)
    cases = cases[cases["fold"] == config.get("fold", 0)]
    return CellResult(config, {}, cases, Path())


def test_folds_and_seeds_are_one_model() -> None:
    jobs = [job({"fold": fold, "seed": seed, "model": {"width": 8}}) for fold in range(3) for seed in (0, 1)]
    pooled = pool(jobs)
    assert set(pooled["model"]) == {"unet"} and len(pooled) == 48
    assert list(pooled.index) == list(range(48))


def test_models_of_one_name_are_told_apart_by_what_differs() -> None:
    jobs = [
        job({"fold": 0, "model": {"width": width, "depth": 5}, "loss": {"_target_": "a.Dice", "power": 2}})
        for width in (8, 16)
    ]
    other = job({"fold": 0, "model": {"width": 32, "depth": 5}, "loss": {"power": 1}}, model="unet3plus")
    elsewhere = job({"fold": 0, "model": {"width": 64, "depth": 5}}, dataset="y")
    pooled = pool([*jobs, other, elsewhere])
    assert list(dict.fromkeys(pooled["model"])) == ["unet width 8", "unet width 16", "unet3plus", "unet"]
    assert set(pooled.loc[pooled["model"] == "unet", "dataset"]) == {"y"}


def test_names_hold_only_what_the_tracker_takes() -> None:
    jobs = [job({"dataset": {"root": root}}) for root in ("/data/a=b", "/data/c,d")]
    assert set(pool(jobs)["model"]) == {"unet root -data-a-b", "unet root -data-c-d"}


def test_how_a_job_is_run_tells_nothing_apart() -> None:
    jobs = [job({"fold": fold, "out": f"folder{fold}", "resume": fold == 1}) for fold in (0, 1)]
    assert set(pool(jobs)["model"]) == {"unet"}


def test_no_cases_are_refused() -> None:
    with pytest.raises(InputError, match="cells: expected at least one job with cases"):
        pool([CellResult({}, {}, None, Path())])


def test_a_case_is_averaged_over_seeds() -> None:
    cases = scored_cases({"unet": 0.0}, seeds=(0, 1))
    first = cases["case_id"] == "x-0-0"
    cases.loc[first, "dsc"] = [0.2, 0.6]
    cases.loc[first, "missed"] = [1.0, 0.0]
    each = once_each(cases)
    assert len(each) == len(cases) / 2
    row = each[each["case_id"] == "x-0-0"].iloc[0]
    assert (row["dsc"], row["missed"]) == (pytest.approx(0.4), 0.5)
    assert np.isnan(each.loc[each["case_id"] == "x-0-3", "dsc"]).all()


def test_a_case_without_a_group_is_not_lost_over_seeds() -> None:
    cases = scored_cases({"unet": 0.0}, seeds=(0, 1))
    cases.loc[cases["case_id"] == "x-0-0", "group"] = None
    assert len(once_each(cases)) == len(cases) / 2


def test_a_single_seed_passes_through() -> None:
    cases = scored_cases({"a": 0.0, "b": 0.1})
    assert once_each(cases) is cases


def test_a_case_scored_twice_by_one_network_is_refused() -> None:
    cases = scored_cases({"unet": 0.0})
    doubled = cases.iloc[[*range(len(cases)), 0]]
    with pytest.raises(InputError, match="received 'x-0-0' of unet on x more than once"):
        once_each(doubled)


def test_groups_and_distances_of_data_sets() -> None:
    cases = scored_cases({"a": 0.0, "b": 0.0}, simulated=True)
    assert [(model, label, len(part)) for model, label, part in groups(cases)] == [
        ("a", "x (simulated)", 24),
        ("b", "x (simulated)", 24),
    ]
    assert distance(cases) == "hd95_px"
    assert distance(scored_cases({"a": 0.0}, spacing_mm=0.2)) == "hd95_mm"
