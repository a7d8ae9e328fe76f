"""The sweep runner: jobs tracked as parent and children, failures that lose nothing, resume, exit codes."""

from __future__ import annotations

import dataclasses
import inspect
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import ModuleType

import pandas as pd
import pytest
import yaml

from experiments.cli import main
from experiments.outcome import Outcome
from experiments.tracking import HASH_TAG, Store


def runs_of(store: Store, kind: str) -> list:
    return [run for run in store.runs(["counting"]) if run.data.tags["ctus.kind"] == kind]


def test_things_that_are_compared_are_runs_of_a_sweep_that_mixes_none_of_their_metrics(
    counting_study: ModuleType, home: Path, capsys
) -> None:
    assert main(["study=counting", "seed=0", f"out={home / 'result'}"]) == 0

    store = Store()
    (parent,) = runs_of(store, "sweep")
    children = runs_of(store, "job")
    assert {run.data.tags["mlflow.parentRunId"] for run in children} == {parent.info.run_id}
    assert {run.info.status for run in [parent, *children]} == {"FINISHED"}
    assert {run.info.run_name for run in children} == {"part 1", "part 2"}
    assert {run.data.tags["level"] for run in children} == {"result"}
    by_part = {run.data.params["part"]: run for run in children}
    assert by_part["2"].data.metrics["value_mean"] == pytest.approx(5 / 3)
    assert by_part["2"].data.metrics["seed_used"] == 0
    # NaN is not a number the tracker keeps: it becomes a count of failures.
    assert by_part["2"].data.metrics["broken_failed"] == 1
    assert "broken" not in by_part["2"].data.metrics
    assert parent.data.metrics == {"jobs": 2, "jobs_failed": 0, "jobs_resumed": 0}
    assert parent.data.tags["level"] == "sweep" and not runs_of(store, "variant")
    assert store.metrics(parent.info.run_id)["parts"] == 2
    said = capsys.readouterr().out
    assert "counted" in said
    assert f"Files: {home / 'result'}" in said
    assert "mlflow ui --backend-store-uri sqlite:///" in said


def test_seeds_of_one_thing_are_repeats_of_a_sweep_with_its_mean_and_spread(
    counting_study: ModuleType, home: Path
) -> None:
    assert main(["-m", "study=counting", "parts=[2]", "seed=0,4"]) == 0

    store = Store()
    (parent,) = runs_of(store, "sweep")
    assert parent.data.tags["level"] == "result" and not runs_of(store, "variant")
    assert {run.data.tags["level"] for run in runs_of(store, "job")} == {"repeat"}
    # mean of 0 and 4; the first metric has the standard deviation over jobs, and no other
    assert parent.data.metrics["seed_used"] == 2
    assert parent.data.metrics["value_mean"] == pytest.approx(5 / 3)
    assert parent.data.metrics["value_mean_std_over_jobs"] == 0
    assert "seed_used_std_over_jobs" not in parent.data.metrics
    # undefined in every job: no mean
    assert "broken" not in parent.data.metrics
    assert parent.data.params["part"] == "2" and "seed" not in parent.data.params


def test_seeds_of_several_things_are_three_levels(counting_study: ModuleType, home: Path) -> None:
    assert main(["-m", "study=counting", "seed=0,4"]) == 0

    store = Store()
    (parent,) = runs_of(store, "sweep")
    variants = {run.data.params["part"]: run for run in runs_of(store, "variant")}
    assert {run.data.tags["mlflow.parentRunId"] for run in variants.values()} == {parent.info.run_id}
    assert {run.info.run_name for run in variants.values()} == {"part 1", "part 2"}
    for part, value in (("1", 4 / 3), ("2", 5 / 3)):
        run = variants[part]
        assert run.data.metrics["value_mean"] == pytest.approx(value) and run.data.metrics["seed_used"] == 2
        assert run.data.tags["level"] == "result" and run.info.status == "FINISHED"
        note = run.data.tags["mlflow.note.content"]
        assert f"| seed 4 of part {part} | {value:.3f} | 4.000 |" in note and "| together |" in note
        assert run.inputs.dataset_inputs[0].dataset.name == "numbers"
        assert store.metrics(run.info.run_id)["value_mean"] == pytest.approx(value)
        own = [job for job in runs_of(store, "job") if job.data.tags["mlflow.parentRunId"] == run.info.run_id]
        assert {job.data.params["seed"] for job in own} == {"0", "4"}
        assert {job.data.params["part"] for job in own} == {part}
    # the list of what is compared, and nothing mixed
    assert parent.data.params["part"] == "1, 2"
    assert set(parent.data.metrics) == {"jobs", "jobs_failed", "jobs_resumed"}
    assert parent.inputs.dataset_inputs[0].dataset.name == "numbers"


def test_a_run_holds_what_is_needed_to_repeat_it(counting_study: ModuleType, home: Path) -> None:
    assert main(["study=counting", "parts=[7]", "seed=3"]) == 0

    store = Store()
    (run,) = store.runs(["counting"])
    client = store.client()
    config = yaml.safe_load(Path(client.download_artifacts(run.info.run_id, "config.yaml")).read_text())
    assert config["part"] == 7
    assert config["seed"] == 3
    assert len(run.data.tags[HASH_TAG]) == 64
    assert json.loads(run.data.tags["ctus.packages"])["mlflow"]
    assert run.data.tags["ctus.machine"]
    assert run.data.tags["mlflow.user"]
    assert run.data.tags["mlflow.source.name"] == "ctus study=counting"
    assert run.data.tags["ctus.command"] == "ctus study=counting 'parts=[7]' seed=3"
    assert "| case_id | value |" in run.data.tags["mlflow.note.content"]
    assert run.info.run_name == "part 7" and run.data.tags["level"] == "result"
    assert [point.value for point in client.get_metric_history(run.info.run_id, "loss")] == [1.0, 0.5]
    assert run.inputs.dataset_inputs[0].dataset.name == "numbers"
    cases = store.cases(run.info.run_id)
    assert cases is not None
    assert cases["value"].tolist() == [1.0, 2.0, 7.0]


def test_a_failed_job_loses_neither_the_others_nor_leaves_half_a_result(
    counting_study: ModuleType, home: Path
) -> None:
    out = home / "result"
    assert main(["study=counting", "parts=[1,2,3]", "fail_on=[2]", f"out={out}"]) == 1

    assert (out / "part-1" / "half.txt").is_file()
    assert (out / "part-3" / "cases.parquet").is_file()
    assert not (out / "part-2").exists()
    assert not list(out.glob(".*partial*"))
    store = Store()
    by_part = {run.data.params["part"]: run for run in runs_of(store, "job")}
    assert by_part["2"].info.status == "FAILED"
    assert "part 2 broke" in by_part["2"].data.tags["ctus.error"]
    (parent,) = runs_of(store, "sweep")
    assert parent.info.status == "FAILED"
    assert parent.data.metrics["jobs_failed"] == 1


def test_resume_runs_only_what_has_not_finished(counting_study: ModuleType, home: Path) -> None:
    counting_study.fail_part = 2
    # Which parts fail must not be a setting here: another setting would be another job.
    real_run = counting_study.run

    def run(*, part, fail_on, refuse_on, seed, workspace, progress):
        broken = [part] if part == counting_study.fail_part else []
        return real_run(
            part=part, fail_on=broken, refuse_on=refuse_on, seed=seed, workspace=workspace, progress=progress
        )

    counting_study.run = run
    assert main(["study=counting", "parts=[1,2,3]"]) == 1
    counting_study.calls.clear()
    counting_study.fail_part = None

    assert main(["study=counting", "parts=[1,2,3]", "resume=true"]) == 0

    assert counting_study.calls == [2]
    store = Store()
    (parent,) = runs_of(store, "sweep")  # the same parent goes on
    assert parent.info.status == "FINISHED"
    assert parent.data.metrics["jobs_resumed"] == 2
    assert store.metrics(parent.info.run_id)["parts"] == 3
    assert parent.data.metrics["jobs_failed"] == 0


def test_resume_goes_on_with_all_levels_and_takes_no_part_of_another_sweep_for_its_own(
    counting_study: ModuleType, home: Path
) -> None:
    assert main(["-m", "study=counting", "parts=[1],[2]", "seed=0,4"]) == 0
    store = Store()
    assert len(runs_of(store, "variant")) == 2
    before = {run.info.run_id for run in store.runs(["counting"])}
    assert main(["-m", "study=counting", "parts=[1],[2]", "seed=0,4", "resume=true"]) == 0
    assert {run.info.run_id for run in store.runs(["counting"])} == before
    assert {run.info.status for run in store.runs(["counting"])} == {"FINISHED"}
    # The same two jobs as one of the variants are a sweep of their own.
    assert main(["-m", "study=counting", "parts=[1]", "seed=0,4", "resume=true"]) == 0
    (other,) = [run for run in runs_of(store, "sweep") if run.info.run_id not in before]
    assert other.data.tags["level"] == "result" and "mlflow.parentRunId" not in other.data.tags
    assert len(counting_study.calls) == 4


def test_resume_brings_back_the_files_of_a_finished_job(counting_study: ModuleType, home: Path) -> None:
    out = home / "result"
    assert main(["study=counting", f"out={out}"]) == 0
    (out / "part-1" / "job.json").write_text('{"config_hash": "another job used this folder"}')
    (out / "part-1" / "half.txt").unlink()

    assert main(["study=counting", f"out={out}", "resume=true"]) == 0

    assert (out / "part-1" / "half.txt").read_text() == "part 1\n"
    assert pd.read_parquet(out / "cases.parquet")["value"].tolist() == pytest.approx([4 / 3, 5 / 3])


def test_a_second_run_into_the_folder_of_the_first_leaves_none_of_its_files(
    counting_study: ModuleType, home: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    out, plain = home / "result", counting_study.run

    def with_more(names: tuple[str, ...]) -> None:
        def run(**given: object) -> Outcome:
            outcome: Outcome = plain(**given)
            return dataclasses.replace(
                outcome, files={name: lambda path: path.write_text("x") for name in names}
            )

        run.__signature__ = inspect.signature(plain)  # type: ignore[attr-defined]
        monkeypatch.setattr(counting_study, "run", run)

    words = ["study=counting", "parts=[1]", f"out={out}"]
    with_more(("both.txt", "first.txt", "read.txt", *(f"more_{k}.txt" for k in range(5))))
    assert main(words) == 0
    (out / "mine.txt").write_text("kept")
    # Another study's folder is not touched, nor what the list names outside, nor what this run reads itself.
    (home / "outside.txt").write_text("kept")
    record = json.loads((out / "job.json").read_text())
    assert {"both.txt", "first.txt", "half.txt", "job.json"} < set(record["files"])
    record["files"].append("../outside.txt")
    (out / "job.json").write_text(json.dumps({**record, "study": "another"}))
    with_more(("both.txt",))
    capsys.readouterr()
    assert main([*words, "seed=1"]) == 0
    assert (out / "first.txt").is_file()
    said = capsys.readouterr().err
    assert "replaced both.txt, cases.parquet" in said and "of study=another, whose other files stay" in said
    (out / "job.json").write_text(json.dumps(record))
    capsys.readouterr()
    assert main([*words, "seed=2", f"data={out / 'read.txt'}"]) == 0
    assert "removed what the run before had left: first.txt, more_0.txt" in capsys.readouterr().err
    names = {path.name for path in out.iterdir()}
    assert {"both.txt", "mine.txt", "read.txt"} <= names and not names & {"first.txt", "more_4.txt"}
    assert (home / "outside.txt").is_file()
    capsys.readouterr()
    assert main([*words, "seed=3"]) == 0
    assert "removed" not in capsys.readouterr().err


def test_without_resume_everything_runs_again(counting_study: ModuleType, home: Path) -> None:
    assert main(["study=counting"]) == 0
    assert main(["study=counting"]) == 0
    assert counting_study.calls == [1, 2, 1, 2]


def test_the_users_mistake_in_a_job_exits_with_2(counting_study: ModuleType, home: Path, capsys) -> None:
    assert main(["study=counting", "parts=[1]", "refuse_on=[1]"]) == 2
    assert capsys.readouterr().err.strip() == "part: expected another one, received 1"
    assert not list(Store().runs(["counting"]))


def test_a_sweep_in_which_all_is_the_users_mistake_leaves_no_run(
    counting_study: ModuleType, home: Path
) -> None:
    assert main(["-m", "study=counting", "seed=0,1", "refuse_on=[1,2]"]) == 2
    assert not list(Store().runs(["counting"]))
    # what did finish stays
    assert main(["-m", "study=counting", "seed=0,1", "refuse_on=[1]"]) == 2
    assert len(runs_of(Store(), "job")) == 2
    (parent,) = runs_of(Store(), "sweep")
    assert parent.info.status == "FAILED" and parent.data.metrics["jobs_failed"] == 2
    (variant,) = runs_of(Store(), "variant")
    assert variant.data.params["part"] == "2" and variant.info.status == "FINISHED"


def test_a_mistake_that_can_be_known_stops_before_the_first_job(
    counting_study: ModuleType, home: Path, capsys
) -> None:
    assert main(["-m", "study=counting", "needed=here,elsewhere"]) == 2
    assert counting_study.calls == []
    assert "needed: expected 'here', received 'elsewhere'" in capsys.readouterr().err
    assert not list(Store().runs(["counting"]))


def test_multirun_is_one_sweep_of_all_cells_of_all_points(counting_study: ModuleType, home: Path) -> None:
    assert main(["-m", "study=counting", "seed=0,1", f"out={home / 'sweep'}"]) == 0

    store = Store()
    (parent,) = runs_of(store, "sweep")
    children = runs_of(store, "job")
    assert len(children) == 4
    assert {run.info.run_name for run in children} == {
        "seed 0 of part 1", "seed 0 of part 2", "seed 1 of part 1", "seed 1 of part 2"
    }  # fmt: skip
    assert parent.info.run_name == "by part"
    assert (home / "sweep" / "seed-1_part-2" / "half.txt").is_file()


def test_tracking_can_be_switched_off(counting_study: ModuleType, home: Path, capsys) -> None:
    assert main(["study=counting", "tracking.enabled=false", f"out={home / 'result'}"]) == 0
    assert (home / "result" / "part-2" / "metrics.json").is_file()
    assert not list(Store().runs(["counting"]))
    assert "Dashboard" not in capsys.readouterr().out


def test_a_dead_runs_are_reaped_and_living_ones_left(counting_study: ModuleType, home: Path) -> None:
    store = Store()
    living = store.start("counting", "living", {"ctus.kind": "job"})
    dead = store.start("counting", "dead", {"ctus.kind": "job"})
    with subprocess.Popen([sys.executable, "-c", ""]) as ended:
        ended.wait()
    dead.tags({"ctus.pid": str(ended.pid)})

    assert store.mark_orphans_failed("counting") == [dead.run_id]
    assert store.client().get_run(dead.run_id).info.status == "FAILED"
    assert store.client().get_run(living.run_id).info.status == "RUNNING"
    living.end("FINISHED")


def test_a_silent_run_of_another_machine_is_reaped(home: Path) -> None:
    store = Store()
    silent = store.start("counting", "silent", {"ctus.kind": "job"})
    beating = store.start("counting", "beating", {"ctus.kind": "job"})
    silent.tags({"ctus.host": "elsewhere", "ctus.heartbeat": f"{time.time() - 3600:.0f}"})
    beating.tags({"ctus.host": "elsewhere"})
    assert store.mark_orphans_failed("counting") == [silent.run_id]
    silent.end("FAILED")
    beating.end("FINISHED")


def test_sigterm_ends_the_run_as_failed(home: Path, repository: Path) -> None:
    program = (
        "import sys, time, signal\n"
        "from experiments.running import run_sweep\n"
        "from experiments.tracking import Store, ending\n"
        "with run_sweep.stoppable():\n"
        "    with ending(Store().start('counting', 'slow', {'ctus.kind': 'job'})) as run:\n"
        "        print(run.run_id, flush=True)\n"
        "        time.sleep(60)\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(repository / "src")}
    with subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, text=True, env=environment
    ) as slow:
        assert slow.stdout is not None
        run_id = slow.stdout.readline().strip()
        slow.send_signal(signal.SIGTERM)
        assert slow.wait(timeout=30) == 128 + signal.SIGTERM
    assert Store().client().get_run(run_id).info.status == "FAILED"


def test_points_that_are_the_same_job_are_one_job_in_one_place(
    counting_study: ModuleType, home: Path
) -> None:
    out = home / "once"
    assert main(["-m", "study=counting", "parts=[1]", "resume=false,true", f"out={out}"]) == 0
    assert counting_study.calls == [1]
    assert (out / "half.txt").is_file()
    assert not [path for path in out.iterdir() if path.is_dir()]


def test_a_sweep_over_what_a_call_has_one_of_is_refused(
    counting_study: ModuleType, home: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for words in (
        ["study=export_runs,import_runs"],
        ["study=counting", f"out={home / 'a'},{home / 'b'}"],
        ["study=counting", "jobs=1,2"],
        ["study=counting", "tracking.enabled=true,false"],
    ):
        assert main(["-m", *words]) == 2
        name = words[-1].split("=")[0].split(".")[0]
        assert f"{name}: expected one value for all jobs of a call, received" in capsys.readouterr().err
    assert counting_study.calls == []
    assert not (home / "results").exists()


def test_folders_of_jobs_that_read_alike_are_not_shared(counting_study: ModuleType, home: Path) -> None:
    roots = [home / "a" / "b", home / "a_b", home / "a-b"]
    for number, root in enumerate(roots):
        root.mkdir(parents=True)
        (root / "x").write_text(str(number))
    out = home / "result"
    words = ["study=counting", "parts=[1]", f"data={','.join(map(str, roots))}", f"out={out}"]
    assert main(["-m", *words]) == 0
    folders = [path for path in out.iterdir() if path.is_dir()]
    assert len(folders) == 3
    assert len({json.loads((path / "job.json").read_text())["config_hash"] for path in folders}) == 3
