"""A tracked run, run again: equal to the last bit, or what differs and by how much; and what can't be run again."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest
from vessels import bent_tube

from experiments.analysis.runs import rerun
from experiments.cli import main
from experiments.studies.reproduce import checks, study
from experiments.tracking import PARENT_TAG, Store
from experiments.tracking.run_lookup import Family
from registration.io.surfaces import write_surface

CLEAN = {
    "mlflow.source.git.commit": "a" * 40,
    "ctus.git_dirty": "false",
    "ctus.packages": '{"numpy": "2"}',
    "ctus.python": "3",
    "ctus.machine": "m",
}


@pytest.fixture
def in_process(home: Path, store_template: Path, monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """Run jobs again in this process, in a project of their own as a process of its own would; list the projects."""
    projects: list[Path] = []

    def run_again(points: list, project: Path, *, sweep: bool) -> Family:
        rerun.write_points(points, project, sweep=sweep)
        (project / "mlruns").mkdir()
        shutil.copy(store_template / "ctus.db", project / "mlruns" / "ctus.db")
        projects.append(project)
        with monkeypatch.context() as inside:
            inside.setenv("CTUS_HOME", str(project))
            return rerun.runs_of(project, rerun.main([str(project)]))

    monkeypatch.setattr(study, "run_again", run_again)
    monkeypatch.setattr(checks, "environment_tags", lambda: dict(CLEAN))
    monkeypatch.setattr("experiments.tracking.store.environment_tags", lambda: dict(CLEAN))
    return projects


def newest(kind: str) -> str:
    return next(run.info.run_id for run in Store().runs() if run.data.tags["ctus.kind"] == kind)


def reproduced(home: Path) -> dict:
    ((found),) = (home / "outputs" / "reproduce").glob("*/reproduction.json")
    return json.loads(found.read_text())


def robustness(folder: Path) -> list[str]:
    write_surface(folder / "tube.ply", bent_tube())
    clouds = ["perturbation.moving_points=300", "perturbation.fixed_points=600"]
    place = [f"target={folder / 'tube.ply'}", "overlaps=[1.0]", "rigid=[single_icp]", "trials=3"]
    return ["study=robustness", *place, *clouds]


def consistency(folder: Path) -> list[str]:
    del folder
    few = ["sweeps=2", "phantom.motion.frames=20", "samples=200", "phantom.tissue.scatterers_per_mm3=4"]
    return ["study=consistency", "phantoms=[artificial]", *few]


def segmentation(folder: Path) -> list[str]:
    del folder
    few = [
        "dataset.subset=artificial",
        "dataset.sweeps=5",
        "dataset.frames_per_sweep=2",
        "dataset.size_px=64",
    ]
    short = ["dataset.workers=1", "trainer.max_epochs=2", "model.width=4", "image_size_px=32"]
    return ["study=segmentation", "trainer=smoke", "fold=0", *few, *short]


@pytest.mark.parametrize("words", [consistency, robustness, segmentation])
def test_runs_of_different_studies_come_out_bit_equal_in_an_empty_store(
    home: Path,
    tmp_path: Path,
    in_process: list[Path],
    capsys: pytest.CaptureFixture[str],
    words: Callable[[Path], list[str]],
) -> None:
    assert main(words(tmp_path)) == 0
    known = len(list(Store().runs()))
    assert main(["study=reproduce", f"run={newest('job')[:10]}"]) == 0
    assert "is bit-equal: " in capsys.readouterr().out
    found = reproduced(home)
    assert found["equal"] is True
    (one,) = found["runs"]
    assert one["numbers"] > 5
    assert one["rows"] > 0
    assert one["left_out"]
    assert not one["differences"]
    # The user's own store has gained nothing, and the project that it was run in is gone.
    assert len(list(Store().runs())) == known
    assert not in_process[0].exists()


def test_of_a_sweep_all_jobs_and_the_summary_are_run_again(
    counting_study: ModuleType, home: Path, in_process: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["study=counting"]) == 0
    counting_study.calls.clear()
    assert main(["study=reproduce", f"run={newest('sweep')}"]) == 0
    assert len(counting_study.calls) == 2
    found = reproduced(home)
    assert [one["equal"] for one in found["runs"]] == [True, True, True]
    assert "3 of 3" not in capsys.readouterr().err


def test_a_number_that_is_another_is_named_with_its_difference(
    counting_study: ModuleType, home: Path, in_process: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["study=counting", "parts=[2]"]) == 0
    job = newest("job")
    store = Store()
    name, value = "value_mean", store.metrics(job)["value_mean"]
    store.client().log_metric(job, name, value + 0.25, step=0, timestamp=4_000_000_000_000)
    capsys.readouterr()
    assert main(["study=reproduce", f"run={job}"]) == 2
    said = capsys.readouterr().out
    assert "is not bit-equal" in said
    assert f"Number that differs most: {name}" in said
    assert ", by 0.25" in said
    assert reproduced(home)["equal"] is False
    assert main(["study=reproduce", f"run={job}", "tolerance=0.3"]) == 0
    assert "equal within 0.3" in capsys.readouterr().out


def test_other_code_stands_in_the_way_unless_it_is_forced_and_then_reported(
    counting_study: ModuleType,
    in_process: list[Path],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["study=counting", "parts=[2]"]) == 0
    other = {"mlflow.source.git.commit": "b" * 40, "ctus.packages": '{"numpy": "3"}', "ctus.machine": "n"}
    monkeypatch.setattr(checks, "environment_tags", lambda: {**CLEAN, **other})
    capsys.readouterr()
    assert main(["study=reproduce", f"run={newest('job')}"]) == 2
    refusal = capsys.readouterr().err
    assert "commit aaaaaaaaaaaa (here bbbbbbbbbbbb); numpy 2 (here 3). Check out that commit" in refusal
    assert "machine" not in refusal
    assert not in_process
    assert main(["study=reproduce", f"run={newest('job')}", "force=true"]) == 0
    said = capsys.readouterr().out
    assert "Not as it was: commit aaaaaaaaaaaa (here bbbbbbbbbbbb); numpy 2 (here 3)." in said
    assert "Made on another machine (m; here n)" in said


def test_a_file_that_has_changed_since_is_found_before_anything_is_run(
    counting_study: ModuleType, tmp_path: Path, in_process: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "numbers.csv").write_text("1\n")
    assert main(["study=counting", "parts=[2]", f"data={tmp_path / 'numbers.csv'}"]) == 0
    (tmp_path / "numbers.csv").write_text("2\n")
    assert main(["study=reproduce", f"run={newest('job')}"]) == 2
    assert "equal numbers can't be expected here: configuration and files read" in capsys.readouterr().err
    assert not in_process


# Archived, a path within the project starts at the project; of any other the name alone is left.
@pytest.mark.parametrize(("in_project", "archived"), [(True, "data/numbers.csv"), (False, ".../numbers.csv")])
def test_an_exported_run_is_run_again_with_data_that_lie_elsewhere(
    counting_study: ModuleType,
    home: Path,
    tmp_path_factory: pytest.TempPathFactory,
    in_process: list[Path],
    capsys: pytest.CaptureFixture[str],
    in_project: bool,
    archived: str,
) -> None:
    data = home / "data" if in_project else tmp_path_factory.mktemp("data")
    data.mkdir(exist_ok=True)
    (data / "numbers.csv").write_text("1\n")
    assert main(["study=counting", "parts=[2]", f"data={data / 'numbers.csv'}"]) == 0
    job, archive, elsewhere = newest("job"), home / "archive", home / "elsewhere"
    assert main(["study=export_runs", f"archive={archive}"]) == 0
    elsewhere.mkdir()
    (data / "numbers.csv").rename(elsewhere / "numbers.csv")
    shutil.rmtree(home / "mlruns")
    asked = ["study=reproduce", f"run={job}", f"archive={archive}"]
    assert main([*asked, f"data_root={elsewhere}"]) == 0
    assert "is bit-equal" in capsys.readouterr().out
    moved = next(check for check in reproduced(home)["checks"] if check["what"] == "paths")
    assert moved["now"] == f"{archived} -> {elsewhere / 'numbers.csv'}"


def test_a_failed_run_and_one_that_is_not_there_are_refused(
    counting_study: ModuleType, in_process: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["study=counting", "fail_on=[2]"]) == 1
    failed = next(
        run.info.run_id
        for run in Store().runs()
        if run.info.status == "FAILED" and PARENT_TAG in run.data.tags
    )
    assert main(["study=reproduce", f"run={failed}"]) == 2
    assert "expected a run that finished, found one that is FAILED" in capsys.readouterr().err
    assert main(["study=reproduce", "run=nothing"]) == 2
    assert "found none that begins with 'nothing'" in capsys.readouterr().err
    # Of the sweep, the job that finished is run again; there is no summary to compare.
    assert main(["study=reproduce", f"run={newest('sweep')}"]) == 0
    assert "only those that had are run again, not its summary" in capsys.readouterr().out


def test_jobs_run_again_in_a_process_of_their_own_and_what_it_refuses_is_told(
    home: Path, store_template: Path, tmp_path: Path
) -> None:
    points = [({"study": "evaluate", "prediction": str(tmp_path / "none")}, "")]
    project = tmp_path / "project"
    (project / "mlruns").mkdir(parents=True)
    shutil.copy(store_template / "ctus.db", project / "mlruns" / "ctus.db")
    with pytest.raises(Exception, match="expected a value for reference"):
        rerun.run_again(points, project, sweep=False)
    assert json.loads((project / rerun.POINTS).read_text())["points"][0][0]["out"] == str(project / "out")
