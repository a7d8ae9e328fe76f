"""A password in the tracking address is found in no file of a run, no archive, no message and no plan."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import pandas as pd
import pytest

from experiments.cli import main
from experiments.running import worker
from experiments.running.jobs import Job
from experiments.tracking import Store, store
from experiments.tracking.store import sqlite_address

SECRET = "S3cr3t/w@rd"
ADDRESS = f"postgresql://me:{SECRET}@db.example:5432/runs"


@pytest.fixture
def behind_a_password(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The project's own store, under an address with a password."""
    real = store._open
    own = sqlite_address(home / "mlruns" / "ctus.db")
    monkeypatch.setattr(
        store, "_open", lambda address, *more: real(own if address == ADDRESS else address, *more)
    )


def holding(folder: Path) -> list[str]:
    """Every file with the secret, tables unpacked."""
    found = []
    for path in (each for each in folder.rglob("*") if each.is_file() and "package" not in each.parts):
        content = path.read_bytes()
        if path.suffix == ".parquet":
            content += pd.read_parquet(path).to_json().replace("\\/", "/").encode()
        if SECRET.encode() in content or b"S3cr3t" in content:
            found.append(str(path.relative_to(folder)))
    return found


@pytest.mark.usefixtures("behind_a_password")
def test_no_file_of_a_run_and_no_printed_line_holds_it(
    counting_study: ModuleType, home: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    real_run = counting_study.run

    def run(*, part, fail_on, refuse_on, seed, workspace, progress, data):
        if part == 2:
            raise RuntimeError(f"no connection to {ADDRESS}")
        return real_run(
            part=part, fail_on=fail_on, refuse_on=refuse_on, seed=seed, workspace=workspace, progress=progress
        )

    counting_study.run = run
    words = [f"tracking.uri='{ADDRESS}'", f"out={home / 'result'}"]
    assert main(["study=counting", *words]) == 1
    assert main(["study=export_runs", words[0], f"archive={home / 'archive'}"]) == 0
    said = capsys.readouterr()
    assert "S3cr3t" not in said.out + said.err
    assert "postgresql://***@db.example:5432/runs" in said.out + said.err
    assert len(list((home / "mlruns").rglob("config.yaml"))) >= 2
    assert holding(home) == []
    (home / "kept.txt").write_text(ADDRESS)  # the search finds what there is
    assert holding(home) == ["kept.txt"]


def test_an_address_that_cannot_be_opened_is_named_without_it(
    home: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(address: str, folder: Path, reads_only: bool) -> None:
        raise RuntimeError(f"could not connect to {address}")

    monkeypatch.setattr(store, "_open", refuse)
    for address in (ADDRESS, f"https://me:{SECRET}@host.example", f"ftp://me:{SECRET}@host.example"):
        assert main(["study=export_runs", f"tracking.uri='{address}'", f"archive={home / 'a'}"]) == 2
        said = capsys.readouterr()
        assert "***@" in said.err
        assert "S3cr3t" not in said.out + said.err
    assert "S3cr3t" not in Store(ADDRESS).dashboard


def test_the_plan_of_several_processes_does_not_hold_it(tmp_path: Path) -> None:
    job = Job({"study": "x", "tracking": {"uri": ADDRESS, "enabled": True}}, "hash", "label")
    worker.write_job(job, tmp_path)
    assert holding(tmp_path) == []
    assert worker.tracker_secret(job.config) == {"MLFLOW_TRACKING_URI": ADDRESS}
    plain = {"study": "x", "tracking": {"uri": "http://host:5000", "enabled": True}}
    assert worker.tracker_secret(plain) == {}
    worker.write_job(Job(plain, "plain", "label"), tmp_path)
    assert "http://host:5000" in (tmp_path / "plain.job.json").read_text()
