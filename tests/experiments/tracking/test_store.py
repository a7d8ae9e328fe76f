"""The tracker: a store that several processes may open first, and what it must not lose."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import pytest

from experiments.outcome import InputData
from experiments.tracking import Store


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
    run.end("FINISHED")
    client = store.client()
    assert [point.value for point in client.get_metric_history(run.run_id, "m29")] == list(
        map(float, range(100))
    )
    data = client.get_run(run.run_id).data
    assert data.metrics["good"] == 2.0
    assert data.metrics["nan_failed"] == data.metrics["far_failed"] == 1.0
    assert not {"nan", "far"} & set(data.metrics)
    assert len(data.params) == 251
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
