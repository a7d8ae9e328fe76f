"""``make faults``: what it looks for is found where it is, and one kill of each small kind loses nothing."""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from pathlib import Path

import fault_kills
import faults
import pandas as pd
import pytest
from fault_checks import half_written, leftovers, numbers
from fault_kills import PHASES, Campaign, Outcome, Phase
from fault_processes import Command, apart, plugin


@pytest.fixture
def campaign(tmp_path: Path, store_template: Path, monkeypatch: pytest.MonkeyPatch) -> Campaign:
    """A campaign whose store is there already, with its study registered for one test."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setenv("PYTHONPATH", "")
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    plugin(tmp_path / "plugin")
    made = Campaign(tmp_path, 0)
    (tmp_path / "templates" / "store" / "mlruns").mkdir(parents=True)
    shutil.copy(store_template / "ctus.db", tmp_path / "templates" / "store" / "mlruns" / "ctus.db")
    return made


SHORT = Phase("sweep", ("study=faults", "parts=[1,2]", "seconds=0.2"), "out")


def test_a_killed_sweep_is_resumed_with_the_same_numbers(campaign: Campaign) -> None:
    outcome = fault_kills.kill_phase(campaign, SHORT, 1)
    assert outcome.attempts == outcome.before_end == 1
    assert outcome.said == []


def test_a_campaign_sees_what_is_lost(campaign: Campaign, monkeypatch: pytest.MonkeyPatch) -> None:
    def spoil(self: Campaign) -> dict:
        state = {"whole": "row 3 missing from index", "runs": [dict(each) for each in real(self)["runs"]]}
        state["runs"][0]["status"] = "RUNNING"
        (self.home / "out" / ".half.partial-host-1").touch()
        return state

    _, expected, metrics = fault_kills.undisturbed(campaign, SHORT)
    real = Campaign.state
    monkeypatch.setattr(Campaign, "state", spoil)
    outcome = Outcome()
    fault_kills._after_resume(campaign, SHORT, {**expected, "cases.parquet": "other"}, metrics, outcome, "0")
    assert {"broken stores", "still RUNNING", "other numbers", "lost runs"} <= set(outcome.counts)


def test_results_that_are_gone_are_not_identical(campaign: Campaign, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Campaign, "state", lambda self: {"whole": "ok", "runs": []})
    campaign.home.mkdir()
    outcome = Outcome()
    fault_kills.compared(campaign, "out", {"cases.parquet": "digest"}, outcome, "0")
    assert outcome.counts == {"other numbers": 1}


def test_half_written_files_and_leftovers_are_found(tmp_path: Path) -> None:
    pd.DataFrame({"value": [1.0, 2.0]}).to_parquet(tmp_path / "whole.parquet")
    (tmp_path / "cut.parquet").write_bytes((tmp_path / "whole.parquet").read_bytes()[:-20])
    (tmp_path / "cut.json").write_text('{"a": 1')
    (tmp_path / ".cases.partial-host-7.parquet").write_bytes(b"half")
    (tmp_path / ".cache" / "plans" / "left").mkdir(parents=True)
    assert half_written(tmp_path) == ["cut.json", "cut.parquet"]
    assert leftovers(tmp_path) == [".cache/plans/left", ".cases.partial-host-7.parquet"]


def test_numbers_are_compared_without_runtimes(tmp_path: Path) -> None:
    table = pd.DataFrame({"tre_mm": [1.0, 2.0], "runtime_s": [3.0, 4.0]})
    for name, shown in {"a": table, "b": table.assign(runtime_s=9.0), "c": table.assign(tre_mm=1.0)}.items():
        (tmp_path / name).mkdir()
        shown.to_parquet(tmp_path / name / "cases.parquet")
    assert numbers(tmp_path / "a") == numbers(tmp_path / "b")
    assert numbers(tmp_path / "a") != numbers(tmp_path / "c")


def test_a_process_that_outlives_its_command_is_found(tmp_path: Path) -> None:
    command = Command(["--version"], tmp_path, tmp_path / "log")
    command.before = lambda: subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    assert command.run() == 0
    assert len(command.outliving(0.2)) == 1
    assert command.outliving(5.0) == []


def test_what_breaks_in_a_process_apart_is_told(tmp_path: Path) -> None:
    assert apart(lambda: {"a": 1}, tmp_path) == {"a": 1}
    with pytest.raises(RuntimeError, match="ValueError: no such store"):
        apart(_broken, tmp_path)


def _broken() -> None:
    raise ValueError("no such store")


@pytest.mark.parametrize("attempts", [0, 1, 2, 50, 100])
def test_the_phases_share_the_attempts(attempts: int) -> None:
    assert sum(faults.shares(attempts)) == attempts
    assert len(faults.shares(attempts)) == len(PHASES)


def test_the_page_has_a_row_a_fault_and_what_was_lost() -> None:
    lost = Outcome(attempts=3, before_end=2)
    lost.harm("lost runs", "1, killed at 0.10 s: job abc")
    rows = {"SIGKILL, sweep": ("killed", lost), "full disk": ("a tmpfs", "not tried: mount: no permission")}
    text = faults.page(rows, argparse.Namespace(seed=5), 60.0)
    assert "| SIGKILL, sweep | 3 | 2 | 1 | 0 |" in text
    assert "| full disk | 0 | not tried: mount: no permission |" in text
    assert "- SIGKILL, sweep: lost runs: 1, killed at 0.10 s: job abc" in text
    assert faults.bad(lost)
    assert not faults.bad("not tried: mount: no permission")
    assert faults.bad("stopped: no answer")


@pytest.mark.services
def test_a_small_campaign_runs_to_its_end(tmp_path: Path, repository: Path) -> None:
    words = ["--quick", "--seed", "3", "--out", str(tmp_path / "page.md")]
    script = [sys.executable, str(repository / "scripts" / "faults.py"), *words]
    done = subprocess.run(script, capture_output=True, text=True, check=False, timeout=900)
    assert done.returncode == 0, done.stdout[-3000:]
    assert "| **all SIGKILLs** | 2 |" in (tmp_path / "page.md").read_text()
