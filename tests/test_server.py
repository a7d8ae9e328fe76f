"""``make server``: MLflow with PostgreSQL on the loopback; who may ask, who may not, and many writers at once."""

from __future__ import annotations

import base64
import os
import signal
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
import server as server_script

pytestmark = pytest.mark.services
WRITERS, STEPS = 8, 50
# A process that logs a run of many steps and one metric a call, with no import of the project's own in the way.
WRITER = f"""
import sys
from experiments.tracking import Store
run = Store().start("writers", sys.argv[1], {{"ctus.kind": "job"}})
for step in range({STEPS}):
    run.metrics({{"value": float(step), "writer": float(sys.argv[1])}}, step)
run.end("FINISHED")
assert not run.incomplete, run.refused
"""


@dataclass
class Running:
    """A server of the script, as a call finds it."""

    folder: Path
    port: int
    process: subprocess.Popen[str] | None = None

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def start(self) -> None:
        words = [sys.executable, str(Path(server_script.__file__)), "--folder", str(self.folder)]
        words += ["--port", str(self.port)]
        self.process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        lines = []
        for line in self.process.stdout:
            lines.append(line)
            if "MLFLOW_TRACKING_PASSWORD" in line:
                return
        raise AssertionError("".join(lines))

    def stop(self) -> int:
        assert self.process is not None
        # As Ctrl-C does, but heard also where the tests run in the background of a shell, which ignores that there.
        self.process.send_signal(signal.SIGTERM)
        return self.process.wait(120)

    def kill_mlflow(self) -> None:
        """What answers requests is killed; the script ends PostgreSQL then."""
        import json

        state = json.loads((self.folder / "server.json").read_text())
        os.killpg(state["server"], signal.SIGKILL)
        assert self.process is not None
        self.process.wait(120)

    def environment(self) -> dict[str, str]:
        return {
            "MLFLOW_TRACKING_URI": self.address,
            "MLFLOW_TRACKING_USERNAME": "ctus",
            "MLFLOW_TRACKING_PASSWORD": (self.folder / "password").read_text(),
        }


@pytest.fixture(scope="module")
def running() -> Iterator[Running]:
    # PostgreSQL runs as another user, who reaches no folder of pytest's.
    with tempfile.TemporaryDirectory(prefix="ctus-server-") as place:
        Path(place).chmod(0o711)
        folder = Path(place) / "server"
        made = Running(folder, server_script.free_port())
        made.start()
        yield made
        assert made.stop() == 0
        assert not (folder / "postgres" / "data" / "postmaster.pid").exists()
        assert not (folder / "server.json").exists()


def status(address: str, password: str | None = None, **headers: str) -> int:
    request = urllib.request.Request(f"{address}/api/2.0/mlflow/experiments/search?max_results=1")
    for name, value in headers.items():
        request.add_header(name.replace("_", "-"), value)
    if password is not None:
        request.add_header("Authorization", "Basic " + base64.b64encode(f"ctus:{password}".encode()).decode())
    try:
        with urllib.request.urlopen(request, timeout=30) as answer:
            return int(answer.status)
    except urllib.error.HTTPError as refusal:
        return refusal.code


def test_only_who_has_the_password_and_names_the_host_is_let_in(running: Running) -> None:
    password = (running.folder / "password").read_text()
    assert status(running.address, password) == 200
    assert status(running.address) == 401
    assert status(running.address, "wrong") == 401
    assert status(running.address, password, Host="evil.example") == 403
    assert status(running.address, password, Host=f"127.0.0.1:{running.port}") == 200


def test_secrets_are_in_files_of_their_owner_and_on_no_command_line(running: Running) -> None:
    secrets = {
        name: (running.folder / name).read_text() for name in ("password", "database_password", "session_key")
    }
    assert len(set(secrets.values())) == 3
    for name in (*secrets, "auth.ini"):
        assert (running.folder / name).stat().st_mode & 0o077 == 0
    lines = []
    for process in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            lines.append(process.read_text(errors="replace"))
        except OSError:  # it has ended
            continue
    assert not [name for name, secret in secrets.items() if any(secret in line for line in lines)]
    logs = "".join(path.read_text(errors="replace") for path in running.folder.rglob("*.log"))
    assert not [name for name, secret in secrets.items() if secret in logs]


def test_a_wrong_password_is_refused_in_one_sentence(
    running: Running, home: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from experiments.cli import main

    monkeypatch.setenv("MLFLOW_TRACKING_URI", running.address)
    assert main(["study=export_runs"]) == 2
    assert "expected the server" in capsys.readouterr().err


def test_eight_writers_lose_no_metric(running: Running, home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from experiments.tracking import Store

    for name, value in running.environment().items():
        monkeypatch.setenv(name, value)
    store = Store()
    store.experiment_id("writers")
    processes = [
        subprocess.Popen([sys.executable, "-c", WRITER, str(number)], stderr=subprocess.PIPE, text=True)
        for number in range(WRITERS)
    ]
    for process in processes:
        assert process.wait(300) == 0, process.stderr.read() if process.stderr else ""
    runs = list(store.runs(["writers"]))
    assert len(runs) == WRITERS
    for run in runs:
        assert run.info.status == "FINISHED"
        history = store.client().get_metric_history(run.info.run_id, "value")
        assert sorted((point.step, point.value) for point in history) == [(n, float(n)) for n in range(STEPS)]
    assert {run.data.metrics["writer"] for run in runs} == {float(number) for number in range(WRITERS)}


def test_a_server_that_is_killed_in_the_middle_of_a_sweep_and_comes_back_has_all_of_it(
    running: Running,
    home: Path,
    counting_study: object,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    from experiments.cli import main
    from experiments.tracking import Store, run_writer

    for name, value in running.environment().items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(run_writer, "LAST_WAIT_S", 1.0)
    real_run: Callable = counting_study.run  # type: ignore[attr-defined]

    def run(*, part, fail_on, refuse_on, seed, workspace, progress):
        if part == 2:
            running.kill_mlflow()
        if part == 4:
            running.start()
        return real_run(
            part=part, fail_on=fail_on, refuse_on=refuse_on, seed=seed, workspace=workspace, progress=progress
        )

    counting_study.run = run  # type: ignore[attr-defined]
    begun = time.monotonic()
    assert main(["study=counting", "parts=[1,2,3,4]", f"out={home / 'result'}"]) == 0
    assert time.monotonic() - begun < 300
    assert "The tracker got" in capsys.readouterr().err
    runs = list(Store().runs(["counting"]))
    jobs = [run for run in runs if run.data.tags["ctus.kind"] == "job"]
    assert {run.info.status for run in runs} == {"FINISHED"}
    assert sorted(run.data.params["part"] for run in jobs) == ["1", "2", "3", "4"]
    for run in jobs:
        assert len(Store().client().get_metric_history(run.info.run_id, "loss")) == 2
        assert "cases.parquet" in {file.path for file in Store().client().list_artifacts(run.info.run_id)}
