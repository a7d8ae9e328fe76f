"""The tracker: a store that several processes may open first, and what it must not lose."""

from __future__ import annotations

import math
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from experiments.outcome import InputData
from experiments.tracking import HASH_TAG, Store
from experiments.tracking.store import sqlite_file


def test_the_dashboards_command_is_one_that_the_users_shell_finds(
    home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Who called ``.venv/bin/ctus`` has not activated that environment."""
    programs = tmp_path / "a b" / "bin"
    programs.mkdir(parents=True)
    for name in ("python", "mlflow"):
        (programs / name).write_text("#!/bin/sh\n")
        (programs / name).chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(programs / "python"))
    monkeypatch.setenv("PATH", "/nowhere")
    assert shlex.split(Store().dashboard)[0] == str(programs / "mlflow")
    monkeypatch.chdir(tmp_path)
    assert Store().dashboard.startswith("'a b/bin/mlflow' ui ")
    monkeypatch.setenv("PATH", str(programs))
    assert Store().dashboard.startswith("mlflow ui ")


def test_processes_that_open_a_new_store_at_once_do_not_break_it(tmp_path: Path, repository: Path) -> None:
    program = (
        "from experiments.tracking import Store\n"
        "run = Store().start('first', 'r', {}); run.metrics({'m': 1.0}); run.end('FINISHED')\n"
    )
    environment = {"PYTHONPATH": str(repository / "src"), "CTUS_HOME": str(tmp_path), "PATH": "/usr/bin:/bin"}
    started = [
        subprocess.Popen([sys.executable, "-c", program], env=environment, stderr=subprocess.PIPE, text=True)
        for _ in range(3)
    ]
    for process in started:
        _, said = process.communicate(timeout=180)
        assert process.returncode == 0, said
    found = list(Store(uri=f"sqlite:///{tmp_path / 'mlruns' / 'ctus.db'}").runs(["first"]))
    assert [run.info.status for run in found] == ["FINISHED"] * 3


def test_many_metrics_go_in_batches_and_all_arrive(home: Path) -> None:
    store = Store()
    run = store.start("many", "r", {})
    run.history({f"m{k}": float(step) for k in range(30)} for step in range(100))
    run.metrics({"good": 2.0, "nan": math.nan, "far": math.inf})
    run.params({f"p{k}": k for k in range(250)})
    run.params({"long": "x" * 10_000})
    run.params({"y" * 300: 1, "y" * 301: 2, "a,b": 3})
    run.end("FINISHED")
    client = store.client()
    assert [point.value for point in client.get_metric_history(run.run_id, "m29")] == list(
        map(float, range(100))
    )
    data = client.get_run(run.run_id).data
    assert data.metrics["good"] == 2.0
    assert data.metrics["nan_failed"] == data.metrics["far_failed"] == 1.0
    assert not {"nan", "far"} & set(data.metrics)
    assert len(data.params) == 254
    assert data.params["p249"] == "249"


def test_the_address_is_absolute_and_follows_the_environment(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert Store().address == f"sqlite:///{home / 'mlruns' / 'ctus.db'}"
    assert (home / "mlruns" / "ctus.db").is_absolute()
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "http://tracker.example")
    assert Store().address == "http://tracker.example"
    assert Store().dashboard == "http://tracker.example"
    assert Store(uri="sqlite:////tmp/x.db").address == "sqlite:////tmp/x.db"


def test_artifacts_lie_under_the_project_whatever_the_current_folder(
    home: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    monkeypatch.chdir(elsewhere)
    store = Store()
    run = store.start("placed", "r", {})
    run.text("hello", "note.txt")
    run.inputs([InputData("phantom", "d" * 64, "simulator")])
    run.end("FINISHED")
    assert list((home / "mlruns" / "artifacts").rglob("note.txt"))
    assert not list(elsewhere.iterdir())


def test_finished_finds_only_finished_runs_of_that_job(home: Path) -> None:
    from experiments.tracking import HASH_TAG

    store = Store()
    assert store.finished("jobs", "aa") is None
    started = {value: store.start("jobs", "r", {HASH_TAG: value}) for value in ("aa", "bb")}
    started["aa"].end("FAILED")
    started["bb"].end("FINISHED")
    assert store.finished("jobs", "aa") is None
    assert store.finished("jobs", "bb") == started["bb"].run_id


@pytest.mark.parametrize("name", ["a b", "a?b", "a%20b", "a#b", "100%", "a&x=1", "a'b", "\u00e4$[b]"])
def test_a_project_folder_may_be_called_anything(
    tmp_path: Path, store_template: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    around = tmp_path / "around"
    home = around / name
    (home / "mlruns").mkdir(parents=True)
    shutil.copy(store_template / "ctus.db", home / "mlruns" / "ctus.db")
    monkeypatch.setenv("CTUS_HOME", str(home))
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    (home / "note.txt").write_text("hello")
    run = Store().start("named", "r", {})
    run.files(home, ["note.txt"])
    run.end("FINISHED")

    (found,) = Store().runs(["named"])
    Store().restore_files(found.info.run_id, tmp_path)
    assert (tmp_path / "note.txt").read_text() == "hello"
    assert list((home / "mlruns" / "artifacts").rglob("note.txt"))
    # Nothing of it lies under a name that was quoted or cut off.
    assert [path.name for path in around.iterdir()] == [name]
    assert shlex.split(Store().dashboard)[-1] == Store().address
    assert sqlite_file(Store().address) == home / "mlruns" / "ctus.db"


def test_a_copied_project_leaves_the_first_one_alone(
    home: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Store().start("copied", "r", {})
    run.text("one", "config.yaml")
    run.end("FINISHED")
    copy = tmp_path_factory.mktemp("copy") / "project"
    shutil.copytree(home, copy)
    monkeypatch.setenv("CTUS_HOME", str(copy))
    (found,) = Store().runs(["copied"])
    assert found.info.artifact_uri.startswith(copy.as_uri())
    fresh = Store().start("copied", "r", {})
    fresh.text("two", "config.yaml")
    fresh.end("FINISHED")
    assert len(list((home / "mlruns" / "artifacts").iterdir())) == 1
    assert len(list((copy / "mlruns" / "artifacts").iterdir())) == 2


def test_files_that_another_project_keeps_stay_where_they_are(
    home: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    address = Store().address
    other = tmp_path_factory.mktemp("other")
    monkeypatch.setenv("CTUS_HOME", str(other))
    run = Store(uri=address).start("shared", "r", {})
    run.text("one", "config.yaml")
    run.end("FINISHED")
    monkeypatch.setenv("CTUS_HOME", str(home))
    (found,) = Store().runs(["shared"])
    assert found.info.artifact_uri.startswith(other.as_uri())
    assert [file.path for file in Store().client().list_artifacts(found.info.run_id)] == ["config.yaml"]


def test_the_run_of_a_process_that_is_known_to_have_ended_is_failed_with_the_reason_and_no_other(
    home: Path,
) -> None:
    store = Store()
    # Of another machine, whose processes cannot be looked up here.
    far = {"ctus.host": "node7", "ctus.pid_space": "elsewhere"}
    killed = store.start("jobs", "killed", {HASH_TAG: "a", "ctus.slurm_job": "5_0", **far})
    other_try = store.start("jobs", "of another call", {HASH_TAG: "a", "ctus.slurm_job": "6_0", **far})
    other_job = store.start("jobs", "other job", {HASH_TAG: "b", "ctus.slurm_job": "5_0", **far})
    assert store.mark_orphans_failed("jobs") == []
    found = store.mark_ended_failed("jobs", [("a", {"ctus.slurm_job": "5_0"}, "TIMEOUT"), ("b", {}, "never")])
    assert found == [killed.run_id]
    run = store.run(killed.run_id)
    assert run is not None and run.info.status == "FAILED" and run.data.tags["ctus.error"] == "TIMEOUT"
    for writer in (other_try, other_job):
        run = store.run(writer.run_id)
        assert run is not None and run.info.status == "RUNNING"


def test_a_store_is_there_once_it_was_made(home: Path, tmp_path: Path) -> None:
    assert Store().exists and Store("http://127.0.0.1:1").exists
    absent = Store(f"sqlite:///{tmp_path / 'none' / 'runs.db'}")
    assert not absent.exists and not (tmp_path / "none").exists()


def test_a_run_that_ends_while_orphans_are_looked_for_is_none(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Store().start("work", "one", {})

    def ends_and_is_gone(tags: object) -> bool:
        run.end("FINISHED")
        return True

    monkeypatch.setattr("experiments.tracking.store.is_gone", ends_and_is_gone)
    assert Store().mark_orphans_failed("work") == []
    (found,) = Store().runs(["work"])
    assert found.info.status == "FINISHED"
