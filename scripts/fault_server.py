"""A tracking server that is away when a call begins, or in its middle, and comes back during it or later."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

from fault_checks import numbers, statuses, store_state, tracked
from fault_kills import Campaign, Outcome
from fault_processes import apart

SWEEP = ("study=faults", "parts=[1,2,3,4]", "seconds=1", "out={home}/out")
WAIT_S = 180.0


class Server:
    """An MLflow server on the loopback with a SQLite file and a folder of its own, killed and started at will."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = int(free.getsockname()[1])
        self.folder = folder
        self.address = f"http://127.0.0.1:{self.port}"
        self.process: subprocess.Popen[bytes] | None = None

    def start(self, *, wait: bool = True) -> None:
        """Start it on its port."""
        words = [sys.executable, "-m", "mlflow", "server", "--host", "127.0.0.1", "--port", str(self.port)]
        words += ["--backend-store-uri", f"sqlite:///{self.folder / 'server.db'}", "--workers", "1"]
        words += ["--artifacts-destination", str(self.folder / "artifacts"), "--serve-artifacts"]
        with (self.folder / "server.log").open("ab") as log:
            self.process = subprocess.Popen(
                words,
                stdout=log,
                stderr=log,
                start_new_session=True,
                env={**os.environ, "MLFLOW_DISABLE_TELEMETRY": "true"},
            )
        if wait:
            self.wait()

    def wait(self) -> None:
        """Wait until it answers."""
        deadline = time.monotonic() + WAIT_S
        while time.monotonic() < deadline:
            try:
                with urllib.request.urlopen(f"{self.address}/health", timeout=2):
                    return
            except OSError:
                time.sleep(0.3)
        raise RuntimeError(f"the server did not answer: {(self.folder / 'server.log').read_text()[-1000:]}")

    def kill(self) -> None:
        """Kill it with all of its processes."""
        if self.process is not None:
            os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()
            self.process = None


def server_gone(campaign: Campaign, attempts: int) -> Outcome:
    """Attempts in turn: away from the start, away in the middle and back, away in the middle until after the end."""
    outcome = Outcome()
    # As empty as the server's own store will be.
    campaign.fill("empty")
    command = campaign.command(SWEEP)
    if command.run() != 0:
        raise RuntimeError(command.said()[-2000:])
    truth = numbers(campaign.home / "out"), tracked(campaign.state())
    for number in range(attempts):
        kind = ("from the start", "in the middle", "until after the end")[number % 3]
        campaign.fill("empty")
        server = Server(campaign.work / f"server-{number}")
        try:
            if kind != "from the start":
                server.start()
            _one(campaign, server, kind, truth, outcome)
        finally:
            server.kill()
    return outcome


def _one(campaign: Campaign, server: Server, kind: str, truth: tuple, outcome: Outcome) -> None:
    words = [*SWEEP, f"tracking.uri={server.address}"]
    command = campaign.command(words).start()
    if kind != "from the start":
        deadline = time.monotonic() + WAIT_S
        while not (campaign.home / "out" / "part-1" / "job.json").exists() and time.monotonic() < deadline:
            time.sleep(0.05)
        server.kill()
        if kind == "in the middle":
            time.sleep(2.0)
            server.start(wait=False)
    code = command.finish()
    outcome.attempts += 1
    outcome.before_end += 1
    if code != 0:
        outcome.harm("refused afterwards", f"{kind}: {code}, {command.said()[-500:]!r}")
    if kind != "in the middle":
        server.start()
    server.wait()
    # Any command delivers what waits.
    later = campaign.command(["study=export_runs", f"tracking.uri={server.address}"])
    if (code := later.run()) != 0:
        outcome.harm("refused afterwards", f"{kind}: {code}, {later.said()[-500:]!r}")
    if numbers(campaign.home / "out") != truth[0]:
        outcome.harm("other numbers", kind)
    state = apart(lambda: store_state(campaign.home, server.address), campaign.work)
    if tracked(state) != truth[1]:
        outcome.harm("lost runs", f"{kind}: {sorted(tracked(state))} are not {sorted(truth[1])}")
    runs = [run for run in state["runs"] if run["kind"] == "job"]
    if len(runs) != len(truth[1]) or any(run["steps"].get("train_loss") != 5 for run in runs):
        outcome.harm("lost runs", f"{kind}: {len(runs)} jobs, {[run['steps'] for run in runs]}")
    if set(statuses(state)) != {"FINISHED"}:
        outcome.harm("still RUNNING", f"{kind}: {dict(statuses(state))}")
    above = {run["id"] for run in state["runs"] if run["kind"] == "sweep"}
    if {run["parent"] for run in runs} != above:
        outcome.harm("lost runs", f"{kind}: jobs are not below the sweep")
