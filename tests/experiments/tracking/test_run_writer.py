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
from experiments.tracking.archive import read_archive

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
    monkeypatch.setattr(store, "_open", lambda address, folder: made)
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
    assert said.count("ctus study=import_runs archive=") == 2
    assert (home / "result" / "part-2" / "cases.parquet").is_file()

    server.up = True
    for part in (2, 3):
        folder = home / "result" / f"part-{part}" / "untracked"
        assert main(["study=import_runs", f"archive={folder}"]) == 0
    counting_study.calls.clear()
    assert main([*call, "resume=true"]) == 0
    assert counting_study.calls == []

    done = [run for run in Store().runs(["counting"]) if run.info.status == "FINISHED"]
    jobs = {run.data.params["part"]: run for run in done if run.data.tags["ctus.kind"] == "job"}
    assert set(jobs) == {"1", "2", "3"}
    assert jobs["2"].data.metrics["value_mean"] == pytest.approx(5 / 3)
    assert jobs["2"].data.metrics["broken_failed"] == 1
    (parent,) = [run for run in done if run.data.tags["ctus.kind"] == "sweep"]
    assert jobs["3"].data.tags["mlflow.parentRunId"] == parent.info.run_id
    assert parent.data.metrics["jobs"] == 3
    # Imported again, nothing is added.
    before = len(list(Store().runs()))
    assert main(["study=import_runs", f"archive={folder}"]) == 0
    assert len(list(Store().runs())) == before
    (kept,) = read_archive(folder)
    assert jobs["3"].data.tags[ORIGIN_TAG] == kept.run_id


def test_no_server_at_the_start_is_said_in_one_sentence(counting_study: ModuleType, capsys) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "0")
        assert main(["study=counting", f"tracking.uri=http://127.0.0.1:{port}"]) == 2
    said = capsys.readouterr().err.strip()
    assert (
        said
        == f"tracking.uri: expected an MLflow server that answers at http://127.0.0.1:{port}, received no answer"
    )
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
