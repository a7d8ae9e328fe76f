"""Rows of several jobs under names that tell them apart."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from experiments.analysis.variants import distinct_names, names_of_files, varying_choices
from experiments.outcome import JobResult


def result(choices: dict[str, str], **config: Any) -> JobResult:
    return JobResult(config, {}, None, Path(), choices=choices)


def test_only_choices_that_vary_under_a_name_become_part_of_it() -> None:
    results = [result({"augmentation": name, "trainer": "cpu"}) for name in ("none", "strong")]
    results.append(result({"augmentation": "none", "trainer": "cpu"}))
    assert distinct_names(results, ["unet", "unet", "other"]) == [
        "unet augmentation=none",
        "unet augmentation=strong",
        "other",
    ]


def test_repetitions_and_how_a_job_is_run_tell_nothing_apart() -> None:
    results = [
        result({"seed": str(k), "resume": str(k), "dataset.cache": str(k), "workers": str(k)}) for k in (0, 1)
    ]
    assert distinct_names(results, ["unet", "unet"], ("seed",)) == ["unet", "unet"]


def test_a_seed_of_the_data_is_no_repetition() -> None:
    results = [result({"dataset.seed": str(k)}) for k in (0, 1)]
    assert varying_choices(results, ["unet", "unet"], ("seed",)) == [
        {"dataset.seed": "0"},
        {"dataset.seed": "1"},
    ]


def test_files_of_one_name_are_named_by_what_differs() -> None:
    assert names_of_files(["/d/a/surface.ply", "/d/b/surface.ply", "/d/aorta.stl"]) == [
        "a/surface.ply",
        "b/surface.ply",
        "aorta",
    ]
    assert names_of_files(["/d/vein.ply", "/d/vein.stl"]) == ["vein.ply", "vein.stl"]
    assert names_of_files(["/x/a/s.ply", "/y/a/s.ply"]) == ["x/a/s.ply", "y/a/s.ply"]
    assert names_of_files(["/x/a.ply"]) == ["a"]
