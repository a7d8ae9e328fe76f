"""The presets plan the figures they are named after, and every point of theirs can be built."""

from __future__ import annotations

import sys
from pathlib import Path

import pandas as pd
import pytest
import robustness_results
from vessels import bent_tube

from experiments.cli import compose_sweep, main
from experiments.errors import InputError
from experiments.running import jobs as job_module
from experiments.running.jobs import Job
from experiments.studies.robustness.design import Condition, conditions
from registration.io.surfaces import write_surface

PIECES = 10  # the whole vessel, and three places at each of three overlaps


def planned(preset: str, *more: str) -> list[Job]:
    (point,) = compose_sweep([f"+sweep={preset}", "target=given", *more], multirun=True)
    return job_module.jobs_of([point])


def designs(planned: list[Job], method: str) -> list[tuple[Condition, ...]]:
    """The conditions of each job of one method."""
    found = []
    for job in planned:
        given = job_module.arguments(job.config)
        if list(given["rigid"]) == [method]:
            found.append(
                conditions(given["perturbation"], given["rotations"], given["factors"], given["trials"])
            )
    return found


def test_the_figure_crosses_rotation_and_overlap_and_takes_the_rest_one_at_a_time() -> None:
    jobs = planned("figure_robustness")
    methods = ["multistart", "single_icp", "single_icp_plane", "gicp", "fpfh_ransac", "fpfh_fgr"]
    assert len(jobs) == len(methods) * (PIECES + 4)
    assert {next(iter(job.config["rigid"])) for job in jobs} == set(methods)
    own = designs(jobs, "gicp")
    for crossed in own[:PIECES]:
        kinds = {each.perturbation.rotation: (each.perturbation.poses.bins, each.trials) for each in crossed}
        assert kinds == {"any": (12, 300), "roll": (12, 300), "flip": (1, 25)}
    assert [[each.level for each in factor] for factor in own[PIECES:]] == [
        [0, 10, 20, 30, 40, 50],
        [0, 0.25, 0.5, 1.0],
        [0, 0.05, 0.1],
        [0, 0.1, 0.2, 0.3],
    ]
    assert all(each.trials == 25 for factor in own[PIECES:] for each in factor)
    assert len({job.hash for job in jobs}) == len(jobs)


def test_the_ablation_hands_centerlines_to_every_variant() -> None:
    jobs = planned("robustness_ablation", "target_centerline=line")
    assert len(jobs) == 7 * 7
    assert all(job.config["hand_centerlines"] for job in jobs)
    given = [job_module.arguments(job.config)["rigid"] for job in jobs[:7]]
    assert [next(iter(each)).removeprefix("multistart_") for each in given] == [
        "multistart",
        "one_start",
        "no_inversion",
        "no_slide",
        "no_centerline",
        "no_pruning",
        "no_offset",
    ]


def test_two_hundred_poses_go_as_far_as_they_should() -> None:
    jobs = planned("aorta_200")
    assert len(jobs) == 2 * PIECES
    for (each,) in designs(jobs, "multistart"):
        assert each.trials == 200
        far = each.perturbation
        assert (far.angle_max_deg, far.translation_max_mm, far.noise_mm) == (180, 50, 0.5)


def test_a_preset_gives_way_to_what_is_said_beside_it() -> None:
    jobs = planned("figure_robustness", "trials=1", "rigid=[gicp]", "factors=null", "overlaps=[1.0]")
    assert len(jobs) == 1
    assert jobs[0].config["trials"] == 1


def test_a_wrong_level_ends_the_sweep_before_its_first_job(tmp_path: Path) -> None:
    write_surface(tmp_path / "tube.ply", bent_tube())
    (point,) = compose_sweep(
        ["+sweep=robustness_small", f"target={tmp_path / 'tube.ply'}", "factors={noise_mm: [0, -1]}"]
    )
    jobs = job_module.jobs_of([point])
    job_module.check(jobs[0].config)
    with pytest.raises(InputError, match=r"factors\.noise_mm: noise_mm: expected a number of at least 0"):
        for job in jobs:
            job_module.check(job.config)


def test_the_presets_leave_the_setting_of_the_same_name_alone() -> None:
    ((config, _),) = compose_sweep(["study=inspect_sweep", "sweep=recording.mha"])
    assert config["sweep"] == "recording.mha"
    with pytest.raises(InputError, match=r"^\+sweep: expected one of .*aorta_200, consolidation_carotid"):
        compose_sweep(["+sweep=figure"])


def test_a_small_sweep_runs_to_its_page(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Through the command line to files, and by the script to the committed page."""
    write_surface(home / "tube.ply", bent_tube())
    words = ["+sweep=robustness_small", f"target={home / 'tube.ply'}", "rigid=[single_icp,single_icp_plane]"]
    small = ["trials=1", "overlaps=[1.0]", "factors=null", "rotations=[any,flip]", "tracking.enabled=false"]
    points = ["perturbation.moving_points=200", "perturbation.fixed_points=400"]
    assert main(["-m", *words, *small, *points, f"out={home / 'found'}"]) == 0
    cases = pd.read_parquet(home / "found" / "cases.parquet")
    assert cases.groupby(["method", "rotation"]).size().tolist() == [4, 1, 4, 1]
    poses = cases.set_index(["rotation", "trial"]).groupby("method")["angle_deg"].apply(list)
    assert poses["single_icp"] == poses["single_icp_plane"]
    monkeypatch.setattr(sys, "argv", ["script", str(home / "found"), "small", str(home / "results")])
    assert robustness_results.main() == 0
    page = (home / "results" / "small.md").read_text()
    assert "10 trials of single_icp, single_icp_plane on tube" in page
    assert "### capture_range" in page
    for figure in ("success_by_angle", "rmse_tre", "errors", "success_curve", "runtime"):
        assert (home / "results" / f"small_{figure}.png").is_file()
    table = pd.read_csv(home / "results" / "small_robustness.csv")
    assert table["trials"].tolist() == [5, 5]
    monkeypatch.setattr(sys, "argv", ["script", str(home)])
    assert robustness_results.main() == 2
