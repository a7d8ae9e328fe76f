"""Cases pooled over jobs: nothing mixed that is not the same, nothing counted twice."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scored_cases import scored_cases

from experiments.analysis.segmentation.case_table import distance, groups, once_each, pool
from experiments.analysis.segmentation.comparison import compare_models
from experiments.analysis.segmentation.summary import pooled_metrics
from experiments.errors import InputError
from experiments.outcome import JobResult
from experiments.tracking.names import tracked_name


def job(
    config: dict[str, Any], model: str = "unet", dataset: str = "x", choices: dict[str, str] | None = None
) -> JobResult:
    cases = scored_cases({model: 0.0}, dataset=dataset)
    cases = cases[cases["fold"] == config.get("fold", 0)]
    return JobResult(config, {}, cases, Path(), choices=choices or {})


def test_folds_and_seeds_are_one_model() -> None:
    jobs = [job({"fold": fold, "seed": seed, "model": {"width": 8}}) for fold in range(3) for seed in (0, 1)]
    pooled = pool(jobs)
    assert set(pooled["model"]) == {"unet"} and len(pooled) == 48
    assert list(pooled.index) == list(range(48))


def test_models_of_one_name_are_told_apart_by_what_was_chosen() -> None:
    augmentations = {
        "none": {"flip": 0.0},
        "strong": {"flip": 0.5, "noise": 0.1, "gamma": [0.5, 2.0], "blur": 3},
    }
    jobs = [
        job({"fold": fold, "augmentation": settings}, choices={"augmentation": name, "seed": "0"})
        for name, settings in augmentations.items()
        for fold in (0, 1)
    ]
    other = job({"fold": 0, "augmentation": augmentations["strong"]}, model="unet3plus")
    pooled = pool([*jobs, other])
    names = ["unet augmentation=none", "unet augmentation=strong", "unet3plus"]
    assert list(dict.fromkeys(pooled["model"])) == names


def test_without_a_command_line_models_are_told_apart_by_few_settings() -> None:
    jobs = [
        job({"fold": 0, "model": {"width": width, "depth": 5}, "loss": {"_target_": "a.Dice", "power": 2}})
        for width in (8, 16)
    ]
    other = job({"fold": 0, "model": {"width": 32, "depth": 5}, "loss": {"power": 1}}, model="unet3plus")
    elsewhere = job({"fold": 0, "model": {"width": 64, "depth": 5}}, dataset="y")
    pooled = pool([*jobs, other, elsewhere])
    names = ["unet model.width=8", "unet model.width=16", "unet3plus", "unet"]
    assert list(dict.fromkeys(pooled["model"])) == names
    assert set(pooled.loc[pooled["model"] == "unet", "dataset"]) == {"y"}
    many = [job({"fold": 0, "augmentation": {f"field{k}": k * (1 + n) for k in range(9)}}) for n in range(2)]
    first, second = dict.fromkeys(pool(many)["model"])
    assert first != second
    assert max(len(first), len(second)) < 30


@pytest.mark.parametrize(
    "roots",
    [("/d/p/A", "/d/p-A"), ("/d/a/b", "/d/a_b"), ("/data/a=b", "/data/a:b"), ("/data/c,d", "/data/c d")],
)
def test_two_folders_are_two_data_sets_whatever_they_are_called(roots: tuple[str, str]) -> None:
    jobs = [job({"dataset": {"root": root}}, choices={"dataset.root": root}) for root in roots]
    pooled = pool(jobs)
    assert set(pooled["model"]) == {"unet"}
    assert list(dict.fromkeys(pooled["dataset"])) == [f"x dataset.root={root}" for root in roots]
    # Their cases have the same names, but are not the same cases: nothing is averaged and no model set against itself.
    assert len(once_each(pooled)) == len(pooled)
    assert not len(compare_models(pooled))
    metrics = pooled_metrics(pooled)
    assert len({tracked_name(name) for name in metrics}) == len(metrics)
    assert all(f"unet/x dataset.root={root}/dsc_mean" in metrics for root in roots)


def test_how_a_job_is_run_tells_nothing_apart() -> None:
    jobs = [job({"fold": fold, "out": f"folder{fold}", "resume": fold == 1}) for fold in (0, 1)]
    assert set(pool(jobs)["model"]) == {"unet"}


def test_no_cases_are_refused() -> None:
    with pytest.raises(InputError, match="results: expected at least one job with cases"):
        pool([JobResult({}, {}, None, Path())])


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
