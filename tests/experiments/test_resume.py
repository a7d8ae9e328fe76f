"""``resume=true``: never an old result for new data, never an empty folder, never another call's sweep."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pandas as pd
import pytest
from mlflow.tracking._tracking_service import utils as tracking_utils

from experiments import provenance
from experiments.cli import main
from experiments.tracking import HASH_TAG, Store


@pytest.fixture
def data(home: Path) -> Path:
    folder = home / "data"
    (folder / "masks").mkdir(parents=True)
    (folder / "masks" / "a.png").write_bytes(b"one")
    return folder


def sweeps(store: Store) -> list:
    return [run for run in store.runs(["counting"]) if run.data.tags["ctus.kind"] == "sweep"]


def test_a_mask_that_was_corrected_inside_a_folder_is_seen(
    counting_study: ModuleType, home: Path, data: Path
) -> None:
    call = ["study=counting", "parts=[1]", f"data={data}", "resume=true"]
    assert main(call) == 0
    assert main(call) == 0
    assert counting_study.calls == [1]
    (data / "masks" / ".DS_Store").write_bytes(b"junk")
    assert main(call) == 0
    assert counting_study.calls == [1]
    (data / "masks" / "a.png").write_bytes(b"two")
    assert main(call) == 0
    assert counting_study.calls == [1, 1]
    # And the old data is the old job.
    (data / "masks" / "a.png").write_bytes(b"one")
    assert main(call) == 0
    assert counting_study.calls == [1, 1]


def test_results_that_lie_inside_the_data_do_not_make_it_other_data(
    counting_study: ModuleType, home: Path, data: Path
) -> None:
    call = ["study=counting", "parts=[1,2]", f"data={data}", f"out={data / 'result'}", "resume=true"]
    assert main(call) == 0
    assert main(call) == 0
    assert counting_study.calls == [1, 2]


@pytest.mark.parametrize("at_once", [1, 2])
def test_data_that_changes_while_it_is_used_gives_no_result_to_go_on_with(
    counting_study: ModuleType, home: Path, data: Path, at_once: int, capsys: pytest.CaptureFixture[str]
) -> None:
    real_run = counting_study.run

    def run(*, part, fail_on, refuse_on, seed, workspace, progress, data):
        if part == 1 and len(counting_study.calls) == 0:
            (Path(data) / "masks" / "a.png").write_bytes(b"two")
        return real_run(
            part=part, fail_on=fail_on, refuse_on=refuse_on, seed=seed, workspace=workspace, progress=progress
        )

    run.__annotations__["data"] = Path
    counting_study.run = run
    call = ["study=counting", f"parts={[*range(1, at_once + 1)]}", f"data={data}"]
    assert main(call) == 0
    assert "what it reads has changed since the call began" in capsys.readouterr().err
    (data / "masks" / "a.png").write_bytes(b"one")
    counting_study.calls.clear()
    counting_study.calls.append(0)
    assert main([*call, "resume=true"]) == 0
    # The second of two jobs was planned with the old data as well, and ran with the new.
    assert counting_study.calls == [0, *range(1, at_once + 1)]


def test_a_renamed_project_keeps_its_runs_files_and_tables(
    counting_study: ModuleType,
    home: Path,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    assert main(["study=counting", f"out={home / 'first'}"]) == 0
    moved = tmp_path_factory.mktemp("renamed") / "project"
    moved.mkdir()
    (home / "mlruns").rename(moved / "mlruns")
    monkeypatch.setenv("CTUS_HOME", str(moved))
    # A process that begins after the move knows nothing of the old place.
    tracking_utils._artifact_repos_cache.clear()

    assert main(["study=export_runs"]) == 0
    archive = moved / "results" / "runs" / "counting"
    assert len(list((archive / "cases").glob("*.parquet"))) == 3
    assert all("parts" in config for config in pd.read_parquet(archive / "runs.parquet")["config"])
    counting_study.calls.clear()
    assert main(["study=counting", "resume=true", f"out={moved / 'new'}"]) == 0
    assert counting_study.calls == []
    assert (moved / "new" / "part-1" / "half.txt").read_text() == "part 1\n"
    # What is new goes where the project is now.
    assert main(["study=counting", "seed=5"]) == 0
    assert not (home / "mlruns").exists()
    places = {run.info.artifact_uri for run in Store().runs(["counting"])}
    assert all(place.startswith((moved / "mlruns" / "artifacts").as_uri()) for place in places)


def test_a_finished_run_whose_files_are_gone_is_run_again(
    counting_study: ModuleType, home: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import shutil

    assert main(["study=counting", "parts=[1]", f"out={home / 'first'}"]) == 0
    shutil.rmtree(home / "mlruns" / "artifacts")
    assert main(["study=counting", "parts=[1]", "resume=true", f"out={home / 'new'}"]) == 0
    assert "can't be brought back" in capsys.readouterr().err
    assert counting_study.calls == [1, 1]
    assert (home / "new" / "half.txt").is_file()


def test_a_sweep_that_is_gone_on_with_names_the_process_that_does_it(
    counting_study: ModuleType, home: Path
) -> None:
    assert main(["study=counting", "fail_on=[2]"]) == 1
    store = Store()
    (parent,) = sweeps(store)
    with subprocess.Popen([sys.executable, "-c", ""]) as ended:
        ended.wait()
    gone = {"ctus.pid": str(ended.pid), "ctus.process_started": "1.0", "ctus.heartbeat": "1"}
    for name, value in gone.items():
        store.client().set_tag(parent.info.run_id, name, value)
    seen: list[str] = []
    real_run = counting_study.run

    def run(*, part, fail_on, refuse_on, seed, workspace, progress, data):
        # Another call of the study begins while this one is under way.
        seen.extend(Store().mark_orphans_failed("counting"))
        (now,) = [one for one in sweeps(Store()) if one.info.run_id == parent.info.run_id]
        seen.append(now.info.status)
        assert now.data.tags["ctus.pid"] == str(os.getpid())
        return real_run(
            part=part, fail_on=[], refuse_on=refuse_on, seed=seed, workspace=workspace, progress=progress
        )

    counting_study.run = run
    assert main(["study=counting", "fail_on=[2]", "resume=true"]) == 0
    assert seen == ["RUNNING"]
    (parent,) = sweeps(store)
    assert parent.info.status == "FINISHED"


def test_a_sweep_that_another_call_is_at_is_not_taken_over(counting_study: ModuleType, home: Path) -> None:
    assert main(["study=counting"]) == 0
    store = Store()
    (parent,) = sweeps(store)
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as other:
        import psutil

        started = psutil.Process(other.pid).create_time()
        for name, value in {"ctus.pid": str(other.pid), "ctus.process_started": f"{started:.2f}"}.items():
            store.client().set_tag(parent.info.run_id, name, value)
        store.client().update_run(parent.info.run_id, status="RUNNING")
        assert main(["study=counting", "resume=true"]) == 0
        assert other.stdin is not None
        other.stdin.close()
    ours = [run for run in sweeps(store) if run.info.run_id != parent.info.run_id]
    assert [run.info.status for run in ours] == ["FINISHED"]
    assert store.client().get_run(parent.info.run_id).info.status == "RUNNING"
    assert ours[0].data.tags[HASH_TAG] == parent.data.tags[HASH_TAG]


def test_a_process_is_known_by_its_id_its_start_and_where_its_id_counts() -> None:
    own = provenance.process_tags()
    assert not provenance.is_gone(own)
    # The same id, started at another time, is another process, unless it still beats: then a clock was set.
    silent = {**own, "ctus.heartbeat": "1"}
    assert not provenance.is_gone(silent)
    assert provenance.is_gone({**silent, "ctus.process_started": "1.0"})
    assert not provenance.is_gone({**own, "ctus.process_started": "1.0"})
    # In another container, or on another machine, the id says nothing.
    for elsewhere in ({"ctus.pid_space": "another boot pid:[1]"}, {"ctus.host": "another"}):
        unknown = {**own, "ctus.pid": "999999999", **elsewhere}
        assert not provenance.is_gone(unknown)
        assert provenance.is_gone({**unknown, "ctus.heartbeat": "1"})
    assert provenance.is_gone({**own, "ctus.pid": "999999999"})
    # Tags that say nothing, or nonsense, leave the heartbeat.
    assert provenance.is_gone({})
    assert not provenance.is_gone({**own, "ctus.pid": "x"})


def test_a_process_that_ended_but_is_not_collected_is_gone() -> None:
    import psutil

    process = subprocess.Popen([sys.executable, "-c", ""])
    try:
        psutil.wait_procs([], timeout=0)
        while psutil.Process(process.pid).status() != psutil.STATUS_ZOMBIE:
            pass
        started = psutil.Process(process.pid).create_time()
        tags = {
            **provenance.process_tags(),
            "ctus.pid": str(process.pid),
            "ctus.process_started": f"{started:.2f}",
        }
        assert provenance.is_gone(tags)
    finally:
        process.wait()
