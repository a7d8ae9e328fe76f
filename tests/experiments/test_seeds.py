"""The one seed of a call reaches every random choice, and what keeps a seed of its own is listed with the reason."""

from __future__ import annotations

import ast
import dataclasses
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
from configurations import OPTIONS, STUDIES, composed, composed_at, mandatory, taker

from experiments import registry
from experiments.cli import main
from experiments.command_line.words import draws_nothing
from experiments.running import jobs

# Seeds that a call's own does not move.
FROZEN = {
    "anatomy_seed": "names one anatomy of a fixed family, as subset names one of the designed ones",
}
# Random numbers in the code that no seed moves: how results are measured and shown, never what they are.
FIXED_DRAWS = {
    "registration/centerline/medial_axis.py": "shakes points off planes, so that a triangulation is not degenerate",
    "experiments/reporting/scene_layers.py": "which points of a large cloud a page shows",
    "experiments/studies/reconstruct/report.py": "places on a surface where its distance to the points is taken",
    "experiments/studies/consistency/report.py": "resamples of an interval",
    "experiments/analysis/consolidation/tables.py": "resamples of an interval",
    "registration/geometry/hollow.py": "points of a wall that are asked whether they lie inside the other",
    "experiments/studies/pipeline/figures.py": "which points a figure shows",
    "experiments/studies/robustness/problem.py": "targets that the error is measured at",
}


def seeds(value: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    """Every number that is called a seed, in mappings, lists and the fields of objects, by its place."""
    if dataclasses.is_dataclass(value):
        value = {each.name: getattr(value, each.name) for each in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        for key, item in value.items():
            if str(key).endswith("seed"):
                yield f"{place}{key}", item
            else:
                yield from seeds(item, f"{place}{key}.")
    elif isinstance(value, (list, tuple)):
        for index, item in enumerate(value):
            yield from seeds(item, f"{place}{index}.")


def assert_all_follow(configs: Mapping[int, Mapping[str, Any]]) -> None:
    """Every seed, also of an object that the configuration does not spell out, is as far from 0 as the call's."""
    at = {
        seed: dict(seeds({key: registry.build(value, key) for key, value in config.items()}))
        for seed, config in configs.items()
    }
    assert at[0].keys() == at[7].keys()
    for place, first in at[0].items():
        name = place.rpartition(".")[2]
        if first is None:  # all seeds of a list, such as training_seed of consolidation
            assert at[7][place] is None, place
            continue
        # Settings that a data set replaces by its own are documented to be of no effect.
        if name not in FROZEN and not place.endswith("settings.seed"):
            assert at[7][place] == first + 7, place


@pytest.mark.parametrize("study", STUDIES)
def test_every_seed_of_a_study_follows_the_global_one_and_changes_the_job(study: str) -> None:
    words = [f"study={study}", *mandatory(study)]
    configs = composed_at((0, 7), *words)
    assert_all_follow(configs)
    first, second = (
        [jobs.arguments(job) for job, _ in jobs.job_configs(config)] for config in configs.values()
    )
    if draws_nothing(study):
        # Nothing that the study is given says "seed", so nothing in it can draw by one.
        assert not list(seeds(first[0])) and "seed" not in first[0]
        assert composed(*words)["seed"] is None
    else:
        assert [dict(seeds(each)) for each in first] != [dict(seeds(each)) for each in second]
        assert composed(*words)["seed"] == 0


@pytest.mark.parametrize("group, option", OPTIONS)
def test_every_seed_of_an_option_follows_the_global_one(group: str, option: str) -> None:
    study = taker(group)
    assert_all_follow(composed_at((0, 7), f"study={study}", f"{group}={option}", *mandatory(study)))


def test_a_study_without_random_choices_says_that_a_seed_changes_nothing(
    tmp_path: Path, home: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["study=export_runs", f"archive={tmp_path / 'archive'}", "tracking.enabled=false"]
    assert main(words) == 0
    assert "seed" not in capsys.readouterr().err
    assert main([*words, "seed=7"]) == 0
    assert "study=export_runs draws nothing at random" in capsys.readouterr().err


def test_random_numbers_in_the_code_take_a_seed_or_are_listed(repository: Path) -> None:
    """A generator made from a number that stands in the code draws the same whatever the seed."""
    found = set()
    for path in sorted((repository / "src").rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            if (
                isinstance(node, ast.Call)
                and isinstance(node.func, ast.Attribute)
                and node.func.attr in ("default_rng", "manual_seed", "RandomState", "SeedSequence")
                and all(isinstance(each, ast.Constant) or _is_constant(each) for each in node.args)
            ):
                found.add(path.relative_to(repository / "src").as_posix())
    assert found == set(FIXED_DRAWS)


def _is_constant(node: ast.expr) -> bool:
    return isinstance(node, ast.Name) and node.id.isupper()
