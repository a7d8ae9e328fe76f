"""A run whose server goes away: nothing of it is lost, and nothing else of the call is held up for long."""

from __future__ import annotations

import socket
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest
from mlflow.exceptions import MlflowException
from mlflow.tracking import MlflowClient

from experiments.cli import main
from experiments.tracking import ORIGIN_TAG, Store, loggable, run_writer, server_unreachable, store
from experiments.tracking.undelivered import waiting

NO_ANSWER = MlflowException(
    "API request to http://x/api/2.0/mlflow/runs/log-batch failed with exception refused"
)


class Server:
    """A store that can be made to behave like a server that does not answer."""

    def __init__(self, client: MlflowClient) -> None:
        self.client = client
        self.up = True

    def __getattr__(self, name: str) -> Callable[..., object]:
        def call(*given: object, **named: object) -> object:
            if not self.up:
                raise NO_ANSWER
            return getattr(self.client, name)(*given, **named)

        return call


@pytest.fixture
def server(home: Path, monkeypatch: pytest.MonkeyPatch) -> Server:
    made = Server(Store().client())
    monkeypatch.setattr(store, "_open", lambda *_: made)
    monkeypatch.setattr(run_writer, "LAST_WAIT_S", 0.0)
    return made


def test_a_server_that_goes_away_in_the_middle_loses_no_result(
    counting_study: ModuleType, home: Path, server: Server, capsys: pytest.CaptureFixture[str]
) -> None:
    real_run = counting_study.run

    def run(*, part, fail_on, refuse_on, seed, workspace, progress):
        if part == 2:
            server.up = False
        return real_run(
            part=part, fail_on=fail_on, refuse_on=refuse_on, seed=seed, workspace=workspace, progress=progress
        )

    counting_study.run = run
    call = ["study=counting", "parts=[1,2,3]", f"out={home / 'result'}"]
    assert main(call) == 0
    said = capsys.readouterr().err
    assert said.count("The tracking server does not answer") >= 1
    assert said.count("a later call delivers it") == 3  # two jobs, and the sweep
    assert (home / "result" / "part-2" / "cases.parquet").is_file()

    server.up = True
    assert main(["study=export_runs"]) == 0
    assert "The tracker got 3 runs" in capsys.readouterr().err
    counting_study.calls.clear()
    assert main([*call, "resume=true"]) == 0
    assert counting_study.calls == []

    runs = list(Store().runs(["counting"]))
    assert {run.info.status for run in runs} == {"FINISHED"}
    jobs = {run.data.params["part"]: run for run in runs if run.data.tags["ctus.kind"] == "job"}
    assert len(runs) == 4
    assert set(jobs) == {"1", "2", "3"}
    assert jobs["2"].data.metrics["value_mean"] == pytest.approx(5 / 3)
    assert jobs["2"].data.metrics["broken_failed"] == 1
    assert len(Store().client().get_metric_history(jobs["2"].info.run_id, "loss")) == 2
    (parent,) = [run for run in runs if run.data.tags["ctus.kind"] == "sweep"]
    assert {run.data.tags["mlflow.parentRunId"] for run in jobs.values()} == {parent.info.run_id}
    assert parent.data.metrics["jobs"] == 3
    # Exported and imported again, nothing is added.
    assert main(["study=export_runs"]) == 0
    assert main(["study=import_runs"]) == 0
    assert len(list(Store().runs())) == 4


def test_a_server_that_is_away_when_the_call_begins_gets_everything_later_in_order_and_once(
    counting_study: ModuleType, home: Path, server: Server, capsys: pytest.CaptureFixture[str]
) -> None:
    def opened(address: str, folder: Path, reads_only: bool) -> Server:
        server.search_experiments(max_results=1)
        return server

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(store, "_open", opened)
        server.up = False
        assert main(["study=counting", f"out={home / 'result'}"]) == 0
        assert "received no answer. The call goes on" in capsys.readouterr().err
        assert main(["study=counting", f"out={home / 'result'}", "resume=true"]) == 2
        assert counting_study.calls == [1, 2]
        kept = waiting(Store().undelivered)
        assert len(kept) == 3
        server.up = True
        assert main(["study=export_runs"]) == 0
    runs = list(Store().runs(["counting"]))
    assert {run.info.status for run in runs} == {"FINISHED"}
    (parent,) = [run for run in runs if run.data.tags["ctus.kind"] == "sweep"]
    jobs = [run for run in runs if run is not parent]
    assert {run.data.tags["mlflow.parentRunId"] for run in jobs} == {parent.info.run_id}
    assert [run.data.tags[ORIGIN_TAG] for run in sorted(runs, key=lambda run: run.info.start_time)] == [
        path.name.partition("-")[2] for path in kept
    ]
    counting_study.calls.clear()
    assert main(["study=counting", f"out={home / 'result'}", "resume=true"]) == 0
    assert counting_study.calls == []
    assert len([run for run in Store().runs(["counting"]) if run.data.tags["ctus.kind"] == "job"]) == 2


def test_a_job_below_a_run_that_the_server_does_not_know_finds_it_when_that_is_delivered(
    counting_study: ModuleType, home: Path, server: Server
) -> None:
    real_run = counting_study.run

    def run(*, part, fail_on, refuse_on, seed, workspace, progress):
        server.up = True
        return real_run(
            part=part, fail_on=fail_on, refuse_on=refuse_on, seed=seed, workspace=workspace, progress=progress
        )

    counting_study.run = run
    real_start = Store.start

    def start(self, *given, **named):
        server.up = server.up and len(started) > 0
        started.append(given)
        return real_start(self, *given, **named)

    started: list = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Store, "start", start)
        assert main(["study=counting", "parts=[1,2]", f"out={home / 'result'}"]) == 0
    runs = list(Store().runs(["counting"]))
    (parent,) = [run for run in runs if run.data.tags["ctus.kind"] == "sweep"]
    assert {run.data.tags.get("mlflow.parentRunId") for run in runs} == {None, parent.info.run_id}
    assert {run.info.status for run in runs} == {"FINISHED"}
    assert len(runs) == 3


@pytest.mark.parametrize(("study", "code"), [("counting", 0), ("export_runs", 2)])
def test_no_server_at_the_start_is_said_in_one_sentence(
    counting_study: ModuleType, home: Path, capsys, study: str, code: int
) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "0")
        patch.setattr(run_writer, "LAST_WAIT_S", 0.0)
        words = ["parts=[1]"] if study == "counting" else []
        assert main([f"study={study}", f"tracking.uri=http://127.0.0.1:{port}", *words]) == code
    said = capsys.readouterr().err.strip()
    assert said.startswith(
        f"tracking.uri: expected an MLflow server that answers at http://127.0.0.1:{port}, received no answer"
    )
    assert "Traceback" not in said


def test_a_server_whose_name_nobody_knows_is_a_wrong_address(counting_study: ModuleType, capsys) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "0")
        assert main(["study=counting", "tracking.uri=http://no-such-host.invalid:5000"]) == 2
    assert "received no answer" in capsys.readouterr().err
    assert counting_study.calls == []


@pytest.mark.parametrize(
    ("error", "silent"),
    [
        (NO_ANSWER, True),
        (
            MlflowException("API request to http://x failed with timeout exception read timed out."),
            True,
        ),
        (MlflowException("API request to endpoint /x failed with error code 503 != 200."), True),
        (ConnectionError("of Python's own, not of a request"), False),
        (MlflowException("API request to endpoint /x failed with error code 400 != 200."), False),
        (MlflowException("Invalid metric name"), False),
    ],
)
def test_what_means_that_a_server_did_not_answer(error: Exception, silent: bool) -> None:
    assert server_unreachable(error) is silent


def test_numbers_that_the_tracker_cannot_hold_become_counts() -> None:
    assert loggable({"a": 1.5, "b": float("nan"), "c": float("inf")}) == {
        "a": 1.5, "b_failed": 1.0, "c_failed": 1.0
    }  # fmt: skip
