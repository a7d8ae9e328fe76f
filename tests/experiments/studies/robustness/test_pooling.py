"""Trials of all jobs pooled: nothing under one name that is not the same, nothing counted as a pair that is none."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd
from robustness_rows import FAR, GOOD, row

from experiments.outcome import JobResult
from experiments.studies.robustness.comparison import comparison
from experiments.studies.robustness.grouping import PROBLEM, with_condition
from experiments.studies.robustness.pooling import pooled
from experiments.studies.robustness.study import shown


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


ANGLES = ("45", "180")


def swept(angle: str, method: str, seed: int, right: bool) -> JobResult:
    """A job of ``perturbation.angle_max_deg=45,180 seed=0,7``; its configuration tells the seed too."""
    choices = {"perturbation.angle_max_deg": angle, "seed": str(seed)}
    found = job(method, choices, seed=seed, perturbation={"angle_max_deg": float(angle)})
    assert found.cases is not None
    found.cases["tre_mm"] = GOOD if right else FAR
    found.cases["success_tre"] = right
    return found


def grid() -> list[JobResult]:
    """A single start succeeds at small angles alone, the multi-start always."""
    return [
        swept(angle, method, seed, right=method == "multistart" or angle == "45")
        for angle in ANGLES
        for seed in (0, 7)
        for method in ("multistart", "single_icp")
    ]


def test_what_was_chosen_for_the_trials_is_a_condition_and_no_method() -> None:
    cases = pooled(grid())
    assert list(dict.fromkeys(cases["method"])) == ["multistart", "single_icp"]
    assert list(dict.fromkeys(cases["condition"])) == ["angle_max_deg=45", "angle_max_deg=180"]
    assert not cases.duplicated([*with_condition(cases, PROBLEM), "method"]).any()
    assert len(cases) == 2 * 2 * 2 * 3
    assert set(cases["trial"]) == set(range(6))


def test_tables_and_comparisons_keep_conditions_apart() -> None:
    outcome = shown(pooled(grid()))
    table = outcome.tables["robustness"]
    assert table[["condition", "method", "trials", "success_tre_rate"]].to_numpy().tolist() == [
        ["angle_max_deg=45", "multistart", 6, 1.0],
        ["angle_max_deg=45", "single_icp", 6, 1.0],
        ["angle_max_deg=180", "multistart", 6, 1.0],
        ["angle_max_deg=180", "single_icp", 6, 0.0],
    ]
    compared = outcome.tables["comparison"]
    assert compared[["condition", "second", "problems", "first_only", "second_only"]].to_numpy().tolist() == [
        ["angle_max_deg=45", "single_icp", 6, 0, 0],
        ["angle_max_deg=180", "single_icp", 6, 6, 0],
    ]
    for name, each in outcome.tables.items():
        assert set(each["condition"]) == {"angle_max_deg=45", "angle_max_deg=180"}, name
    assert outcome.findings[3].startswith("single_icp, angle_max_deg=180, at overlap 1: 0 of 6 trials")


def test_with_several_anatomies_each_condition_has_its_rates_over_them() -> None:
    results = [
        swept(angle, method, 0, right=angle == "45")
        for angle in ANGLES
        for method in ("multistart", "single_icp")
    ]
    twice = [
        JobResult({**each.config, "target": target}, {}, each.cases, Path(), choices=each.choices)
        for target in ("/d/a.ply", "/d/b.ply")
        for each in results
    ]
    table = shown(pooled(twice)).tables["anatomies"]
    assert table[["condition", "method", "anatomies", "success_tre_rate"]].to_numpy().tolist() == [
        ["angle_max_deg=45", "multistart", 2, 1.0],
        ["angle_max_deg=45", "single_icp", 2, 1.0],
        ["angle_max_deg=180", "multistart", 2, 0.0],
        ["angle_max_deg=180", "single_icp", 2, 0.0],
    ]


def test_a_condition_has_one_name_for_all_methods_whichever_jobs_failed() -> None:
    cases = pooled([each for number, each in enumerate(grid()) if number not in (5, 7)])
    assert set(cases.loc[cases["method"] == "single_icp", "condition"]) == {"angle_max_deg=45"}


def test_one_perturbation_has_no_column_and_methods_their_own_names() -> None:
    choices = {"perturbation": "noisy"}
    cases = pooled([job(method, choices) for method in ("multistart", "single_icp")])
    assert "condition" not in cases
    assert set(cases["method"]) == {"multistart", "single_icp"}
    assert not any("condition" in table for table in shown(cases).tables.values())


def test_settings_of_the_method_stay_in_its_name_beside_a_condition() -> None:
    cases = pooled(
        [
            job("multistart", {"rigid.multistart.starts.rolls": rolls, "perturbation": name})
            for rolls in ("12", "24")
            for name in ("noisy", "far")
        ]
    )
    assert list(dict.fromkeys(cases["method"])) == [
        "multistart rigid.multistart.starts.rolls=12",
        "multistart rigid.multistart.starts.rolls=24",
    ]
    assert list(dict.fromkeys(cases["condition"])) == ["perturbation=noisy", "perturbation=far"]


def test_without_a_command_line_a_condition_is_the_settings_that_differ() -> None:
    cases = pooled(
        [
            job(
                method,
                seed=seed,
                perturbation={"noise_mm": noise, "rotation": "any"},
                rigid={method: {"seed": seed}},
            )
            for noise in (0.0, 1.0)
            for seed in (0, 1)
            for method in ("multistart", "single_icp")
        ]
    )
    assert set(cases["method"]) == {"multistart", "single_icp"}
    assert list(dict.fromkeys(cases["condition"])) == ["noise_mm=0.0", "noise_mm=1.0"]


def test_kinds_of_rotation_have_their_own_column_already() -> None:
    cases = pooled([job("multistart", {"perturbation.rotation": kind}) for kind in ("any", "roll")])
    assert "condition" not in cases and set(cases["method"]) == {"multistart"}


def test_two_centerlines_of_one_target_are_two_conditions_and_those_of_two_targets_none() -> None:
    lines = [
        job("multistart", {"target_centerline": line}, target="/d/a.ply", target_centerline=line)
        for line in ("x.vtp", "y.vtp")
    ]
    assert set(pooled(lines)["condition"]) == {"target_centerline=x.vtp", "target_centerline=y.vtp"}
    own = [
        job("multistart", target=f"/d/{name}.ply", target_centerline=f"/d/{name}.vtp") for name in ("a", "b")
    ]
    assert "condition" not in pooled(own)


def test_a_trial_that_two_points_of_a_sweep_share_counts_once() -> None:
    """The levels of a factor are the same trials whatever rotations are crossed besides."""
    cases = pooled([job("multistart", {"rotations": kinds}) for kinds in ("[any]", "[roll]")])
    assert len(cases) == 3
