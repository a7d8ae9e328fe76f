"""``dry_run=true``: all is checked and priced, nothing is started, and the tracker stays as it is to the byte."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType

import pytest

from experiments.cli import main
from experiments.running.dry_run import EarlierRun, priced, summary
from experiments.running.jobs import Job


def state_of(folder: Path) -> dict[str, str]:
    """Every file below a folder with a digest of its content, but for the locks of a store."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.suffix != ".lock" and path.name != ".lock" and "package" not in path.parts
    }


def test_nothing_starts_and_nothing_is_written(
    counting_study: ModuleType, home: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["study=counting", f"out={home / 'out'}"]) == 0
    before = state_of(home)
    sweep = ["-m", "study=counting", "dry_run=true", "seed=0,1", f"out={home / 'new'}"]
    assert main(sweep) == 0
    assert state_of(home) == before
    assert counting_study.calls == [1, 2]
    said = capsys.readouterr().out
    assert "4 jobs: 0 finished, 4 to run (2 of them had finished: resume=true skips these)" in said
    assert "1 run of this very job" in said and "1 run of the same settings" in said
    assert "unknown" not in said and "Nothing was started (dry_run=true)." in said
    assert main([*sweep, "resume=true"]) == 0
    assert "4 jobs: 2 finished, 2 to run; about " in capsys.readouterr().out
    assert state_of(home) == before and counting_study.calls == [1, 2]


def test_where_there_is_no_store_none_is_made(
    counting_study: ModuleType, home: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (home / "mlruns" / "ctus.db").unlink()
    (home / "mlruns").rmdir()
    assert main(["study=counting", "dry_run=true"]) == 0
    assert not (home / "mlruns").exists()
    assert "the time of 2 unknown" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["needed=elsewhere"], "needed: expected 'here'"),
        (["data=/no/such/folder"], "/no/such/folder"),
        (["nonsense=1"], "nonsense"),
        (["jobs=0"], "jobs: expected a whole number"),
        (["dry_run=perhaps"], "dry_run: expected true or false"),
        (["launcher=slurn"], "launcher: expected one of local, slurm, slurm_gpu"),
        (["launcher=slurm", "launcher.cpus=0"], "launcher.cpus: expected at least 1"),
        (["launcher=slurm", "launcher.cpuss=2"], "launcher.cpuss"),
        (["launcher=slurm", "jobs=2"], "jobs: expected 1 with launcher=slurm"),
        (["+launcher.cpus=2"], "launcher.cpus: expected no settings of launcher=local"),
        (["launcher.kind=ray"], "launcher.kind: expected one of local, slurm, received 'ray'"),
    ],
)
def test_what_a_run_would_refuse_a_dry_run_refuses(
    counting_study: ModuleType, home: Path, more: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    for dry in ("true", "false"):
        words = ["study=counting", f"dry_run={dry}", *more]
        if "/no/such/folder" in said:
            # A path that is read and missing is the study's to refuse; its hash says that nothing lies there.
            assert main(["study=robustness", "target=/no/such/folder", f"dry_run={dry}"]) == 2
        else:
            assert main(words) == 2
        assert said in capsys.readouterr().err
    assert counting_study.calls == []


def job(part: int, key: str, **more: object) -> Job:
    config = {"study": "ct_model", "part": part, "seed": 0, "call": {"settings": ["part"]}, **more}
    return Job(config, key, f"part={part}")


def earlier(key: str, seconds: float, **params: str) -> EarlierRun:
    return EarlierRun(key, params, seconds)


@pytest.fixture
def plain_parameters(monkeypatch: pytest.MonkeyPatch) -> None:
    def parameters(job: Job) -> Mapping[str, str]:
        return {name: str(job.config[name]) for name in ("part", "seed", "model") if name in job.config}

    monkeypatch.setattr("experiments.running.dry_run.run_names.parameters", parameters)


def test_the_closest_earlier_runs_give_the_price(plain_parameters: None) -> None:
    runs = [
        earlier("b", 10.0, part="2", seed="7", model="unet"),
        earlier("b", 30.0, part="2", seed="8", model="unet"),
        earlier("c", 50.0, part="2", seed="9", model="unet"),
        earlier("d", 7.0, part="9", seed="0", model="wide"),
    ]
    jobs = [
        job(2, "c", model="unet"),
        job(2, "new", model="unet"),
        job(3, "other", model="wide"),
        job(3, "none", model="unknown"),
    ]
    prices = priced(jobs, runs)
    assert [price.seconds for price in prices[:3]] == [50.0, 30.0, 7.0]
    assert prices[0].source == "1 run of this very job" and prices[0].state == "runs again"
    assert prices[1].source == "median of 3 runs of the same settings" and prices[1].state == "to run"
    assert prices[2].source == "1 run of wide with other settings (rough)"
    assert prices[3].seconds != prices[3].seconds and prices[3].source == "no earlier run"
    assert summary(prices, 2) == (
        "4 jobs: 0 finished, 4 to run (1 of them had finished: resume=true skips these); "
        "about 87 s of jobs, 50 s with 2 at a time; the time of 1 unknown."
    )
    assert summary(prices, 1).count("87 s with 1 at a time") == 1


def test_a_finished_job_that_is_resumed_costs_nothing(plain_parameters: None) -> None:
    (price,) = priced([job(2, "c", resume=True)], [earlier("c", 50.0, part="2", seed="0")])
    assert (price.state, price.seconds) == ("finished", 0.0)
    assert summary([price], 4) == "1 job: 1 finished, 0 to run."
