"""Jobs side by side in processes of their own: all are run, and one that is killed takes no other with it."""

from __future__ import annotations

import sys
from pathlib import Path

import pandas as pd
import pytest
from vessels import bent_tube

from experiments.cli import main
from experiments.errors import InputError
from experiments.running import launcher, local_processes
from experiments.running.jobs import Job, Plan
from experiments.running.local_processes import LocalProcesses
from experiments.tracking import Store
from registration.io.surfaces import write_surface

# A process in the place of a real one: it notes when it started and ended, reports, or ends as its job says.
STAND_IN = """
import json, os, signal, sys, time
from pathlib import Path
folder, key = Path(sys.argv[1]), sys.argv[2]
config = json.loads((folder / f"{key}.job.json").read_text())["config"]
Path(__file__).with_name(f"{key}.threads").write_text(os.environ["OMP_NUM_THREADS"])
Path(__file__).with_name(f"{key}.gpu").write_text(os.environ.get("CUDA_VISIBLE_DEVICES", "none"))
Path(__file__).with_name(f"{key}.plan").write_text(str(folder / "plan.json"))
(folder / f"{key}.started").write_text("")
if config["ends"] == "killed":
    os.kill(os.getpid(), signal.SIGKILL)
if config["ends"] == "waits for the other":
    other = folder / f"{config['other']}.started"
    for _ in range(600):
        if other.exists():
            break
        time.sleep(0.05)
    else:
        sys.exit(3)
(folder / f"{key}.json").write_text(json.dumps(
    {"hash": key, "label": key, "status": "finished", "folder": str(folder), "findings": []}))
"""


def planned(folder: Path, **ends: dict) -> tuple[list[Job], Plan, list[str]]:
    program = folder / "worker.py"
    program.write_text(STAND_IN)
    jobs = [Job(config, key, key) for key, config in ends.items()]
    return (
        jobs,
        Plan("counting", {job.hash: job.label for job in jobs}, str(folder)),
        [sys.executable, str(program)],
    )


def test_two_jobs_run_at_the_same_time(home: Path, tmp_path: Path) -> None:
    waiting = {"ends": "waits for the other"}
    jobs, plan, worker = planned(tmp_path, a={**waiting, "other": "b"}, b={**waiting, "other": "a"})
    reports = LocalProcesses(2, worker).run(jobs, plan).reports
    assert {key: report.status for key, report in reports.items()} == {"a": "finished", "b": "finished"}


def test_a_killed_job_is_reported_and_takes_no_other_with_it(home: Path, tmp_path: Path, capsys) -> None:
    well = {"ends": "well"}
    jobs, plan, worker = planned(tmp_path, a=well, b={"ends": "killed"}, c=well, d=well)
    reports = LocalProcesses(2, worker).run(jobs, plan).reports
    assert {key: report.status for key, report in reports.items()} == {
        "a": "finished",
        "b": "failed",
        "c": "finished",
        "d": "finished",
    }
    assert "signal 9" in reports["b"].message
    assert "b: its process ended by signal 9" in capsys.readouterr().err


def test_the_cores_are_shared_out_unless_the_user_says_otherwise(
    home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    monkeypatch.setattr(local_processes.os, "cpu_count", lambda: 8)
    jobs, plan, worker = planned(tmp_path, a={"ends": "well"})
    LocalProcesses(3, worker).run(jobs, plan)
    assert (tmp_path / "a.threads").read_text() == "2"
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    LocalProcesses(3, worker).run(jobs, plan)
    assert (tmp_path / "a.threads").read_text() == "7"


def test_two_jobs_at_a_time_have_a_gpu_each_where_there_are_two(
    home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    waiting = {"ends": "waits for the other"}
    jobs, plan, worker = planned(tmp_path, a={**waiting, "other": "b"}, b={**waiting, "other": "a"})
    LocalProcesses(2, worker, gpus=("0", "1")).run(jobs, plan)
    assert [(tmp_path / f"{key}.gpu").read_text() for key in "ab"] == ["0", "1"]
    monkeypatch.delenv("CUDA_VISIBLE_DEVICES", raising=False)
    LocalProcesses(2, worker, gpus=("0",)).run(jobs, plan)
    assert [(tmp_path / f"{key}.gpu").read_text() for key in "ab"] == ["none", "none"]


def test_a_study_gives_the_same_by_one_process_and_by_two(home: Path) -> None:
    write_surface(home / "tube.ply", bent_tube())
    call = ["study=robustness", f"target={home / 'tube.ply'}", "trials=1", "rigid=[single_icp]", "seed=4"]
    assert main([*call, f"out={home / 'one'}", "tracking.enabled=false"]) == 0
    assert main([*call, f"out={home / 'two'}", "jobs=2"]) == 0
    one, two = (pd.read_parquet(home / name / "cases.parquet") for name in ("one", "two"))
    changing = [name for name in one if name.endswith("_s")]
    pd.testing.assert_frame_equal(one.drop(columns=changing), two.drop(columns=changing))
    children = [run for run in Store().runs(["robustness"]) if run.data.tags["ctus.kind"] == "job"]
    assert len(children) == 2
    assert {run.info.status for run in children} == {"FINISHED"}


@pytest.mark.parametrize("jobs", ["0", "-1", "1.5", "true", "many"])
def test_a_number_of_jobs_that_is_none_is_refused(home: Path, jobs: str, capsys) -> None:
    assert main(["study=robustness", "trials=2", f"jobs={jobs}"]) == 2
    assert "jobs: expected a whole number" in capsys.readouterr().err


def test_the_plan_lies_under_the_project_while_jobs_run_and_is_gone_when_they_ended(
    home: Path, tmp_path: Path
) -> None:
    jobs, plan, worker = planned(tmp_path, a={"ends": "well"}, b={"ends": "killed"})
    LocalProcesses(2, worker).run(jobs, plan)
    place = Path((tmp_path / "a.plan").read_text())
    assert place.parent.parent == home / ".cache" / "plans"
    assert not place.exists() and not (home / ".cache" / "plans").exists()


def test_a_project_that_cannot_be_written_is_refused_before_a_job_starts(home: Path, tmp_path: Path) -> None:
    jobs, plan, worker = planned(tmp_path, a={"ends": "well"})
    (home / ".cache").write_text("a file where the folder would be")
    with pytest.raises(InputError, match="jobs: expected a project folder that can be written"):
        LocalProcesses(2, worker).run(jobs, plan)
    assert not (tmp_path / "a.threads").exists()


def test_another_calls_plan_stays(home: Path, tmp_path: Path) -> None:
    _, plan, _ = planned(tmp_path, a={"ends": "well"})
    with launcher.plan_folder(plan) as other:
        with launcher.plan_folder(plan) as own:
            assert Plan.read(own) == Plan.read(other) == plan
        assert other.is_dir() and not own.exists()


@pytest.mark.parametrize(
    "more", [["hydra/launcher=joblib"], ["hydra/sweeper=basic"], ["hydra.launcher.n_jobs=2"]]
)
def test_a_launcher_of_hydras_is_refused_with_what_to_use(home: Path, more: list[str], capsys) -> None:
    assert main(["-m", "study=robustness", "trials=2", "seed=0,1", *more]) == 2
    assert "jobs=<number> runs as many at the same time" in capsys.readouterr().err


def test_a_sweep_runs_its_jobs_in_processes_too(home: Path) -> None:
    write_surface(home / "tube.ply", bent_tube())
    call = [
        "study=robustness",
        f"target={home / 'tube.ply'}",
        "trials=1",
        "rigid=[single_icp]",
        "overlaps=[1.0]",
    ]
    assert main(["-m", *call, "seed=1,2", "jobs=2", f"out={home / 'out'}", "tracking.enabled=false"]) == 0
    assert len(list((home / "out").glob("*/job.json"))) == 2
