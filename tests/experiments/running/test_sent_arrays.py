"""Arrays of other calls: tidied up once they are over, waited for by the same call, refused to all others."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from pretended_slurm import PretendedSlurm, pretend

from experiments.errors import InputError
from experiments.running import sent_arrays, slurm_queue
from experiments.running.jobs import Job, Plan
from experiments.running.slurm_queue import SlurmState

JOBS = [Job({}, key, key) for key in ("aa", "bb")]
PLAN = Plan("counting", {"aa": "a", "bb": "b"}, "/out")


@pytest.fixture
def slurm(home: Path, monkeypatch: pytest.MonkeyPatch) -> PretendedSlurm:
    return pretend(monkeypatch)


def left(home: Path, *, gone: bool) -> Path:
    """The folder of an array as a call that is gone, or still waits, has it."""
    folder = home / ".cache" / "plans" / "slurm-counting-x"
    folder.mkdir(parents=True)
    PLAN.write(folder)
    sent_arrays.write(folder, {"aa": "5_0", "bb": "5_1"})
    if gone:
        record = json.loads((folder / "array.json").read_text())
        record["process"]["ctus.pid"] = "4194305"  # above the largest there is
        (folder / "array.json").write_text(json.dumps(record))
    return folder


def test_a_folder_lasts_as_long_as_its_call(home: Path) -> None:
    with sent_arrays.folder(PLAN) as folder:
        assert Plan.read(folder) == PLAN and folder.parent == home / ".cache" / "plans"
    assert not folder.parent.exists()


def test_jobs_that_still_run_are_refused_to_another_call_and_those_over_are_not(
    home: Path, slurm: PretendedSlurm
) -> None:
    folder = left(home, gone=True)
    slurm.state_of = {"5_0": SlurmState("COMPLETED"), "5_1": SlurmState("RUNNING")}
    with pytest.raises(InputError, match=r"1 of 2 jobs of this call are in the queue of Slurm \(job 5\)"):
        sent_arrays.require_free(JOBS, waits=False)
    sent_arrays.require_free(JOBS[:1], waits=False)
    sent_arrays.require_free(JOBS, waits=True)
    assert sent_arrays.of_orphans(JOBS) == {"bb": (folder, "5_1")}
    assert folder.is_dir()


def test_a_call_that_still_waits_keeps_its_jobs(home: Path, slurm: PretendedSlurm) -> None:
    left(home, gone=False)
    slurm.state_of = {"5_0": SlurmState("PENDING"), "5_1": SlurmState("RUNNING")}
    with pytest.raises(InputError, match="the call that sent them waits for them"):
        sent_arrays.require_free(JOBS, waits=True)
    assert sent_arrays.of_orphans(JOBS) == {}


@pytest.mark.parametrize("gone", [True, False])
def test_an_array_that_is_over_is_tidied_up_once_its_call_is_gone(
    home: Path, slurm: PretendedSlurm, gone: bool
) -> None:
    folder = left(home, gone=gone)
    slurm.state_of = {"5_0": SlurmState("COMPLETED")}  # the other one is forgotten
    sent_arrays.require_free(JOBS, waits=False)
    assert folder.exists() is not gone


def test_a_slurm_that_does_not_answer_is_no_sign_that_jobs_are_over(
    home: Path, slurm: PretendedSlurm, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = left(home, gone=True)
    monkeypatch.setattr(slurm_queue, "states", lambda ids: None)
    with pytest.raises(InputError, match="expected an answer of Slurm"):
        sent_arrays.require_free(JOBS, waits=True)
    assert folder.is_dir()


def test_what_is_no_record_is_passed_over(home: Path, slurm: PretendedSlurm) -> None:
    folder = left(home, gone=True)
    for text in ("", "[]", '{"jobs": {}}'):
        (folder / "array.json").write_text(text)
        sent_arrays.require_free(JOBS, waits=False)
