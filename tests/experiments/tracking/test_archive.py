"""Runs as Parquet: what is exported here is the same run when restored elsewhere."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from types import ModuleType

import pandas as pd
import pytest

from experiments.cli import main
from experiments.errors import InputError
from experiments.outcome import InputData
from experiments.tracking import ORIGIN_TAG, PARENT_TAG, Store
from experiments.tracking.archive import read_archive, without_folders, write_archive
from experiments.tracking.run_record import RunRecord


def record(run_id: str, parent_id: str | None = None, value: float = 1.0) -> RunRecord:
    history = pd.DataFrame(
        [("dsc", 0, 0.5, 111), ("dsc", 1, value, 222)], columns=["metric", "step", "value", "timestamp_ms"]
    )
    cases = pd.DataFrame({"case_id": ["a", "b"], "dsc": [0.1, float("inf")]})
    return RunRecord(
        run_id, "segmentation", f"run {run_id}", "FINISHED", 1000, 2000, parent_id, {"k": "v"}, {"fold": "0"},
        "fold: 0\n", history, cases,
    )  # fmt: skip


def test_write_then_read_gives_the_same_runs_parents_first(tmp_path: Path) -> None:
    assert write_archive([record("child", "parent"), record("parent")], tmp_path) == 2
    parent, child = read_archive(tmp_path)
    assert (parent.run_id, child.run_id, child.parent_id) == ("parent", "child", "parent")
    assert child.params == {"fold": "0"}
    assert child.tags == {"k": "v"}
    assert child.history["value"].tolist() == [0.5, 1.0]
    assert child.cases is not None
    assert child.cases["dsc"].tolist() == [0.1, float("inf")]


def test_three_levels_come_from_the_top_down(tmp_path: Path) -> None:
    # by their ids the lowest would come first
    write_archive([record("z"), record("y", "z"), record("x", "y"), record("w", "gone")], tmp_path)
    found = [run.run_id for run in read_archive(tmp_path)]
    assert found.index("z") < found.index("y") < found.index("x") and "w" in found


def test_jobs_whose_sweep_was_not_exported_are_one_sweep_in_the_archive(tmp_path: Path) -> None:
    jobs = [
        dataclasses.replace(record("a", "gone"), tags={"fold": "0", "host": "h"}, start_ms=5, end_ms=20),
        dataclasses.replace(record("b", "gone"), tags={"fold": "1", "host": "h"}, start_ms=3, end_ms=None),
    ]
    write_archive(
        [*jobs, record("c", "elsewhere"), dataclasses.replace(record("elsewhere"), experiment="other")],
        tmp_path,
    )
    runs = {run.run_id: run for run in read_archive(tmp_path)}
    assert list(runs).index("gone") < list(runs).index("a")
    sweep = runs["gone"]
    assert (sweep.name, sweep.status, sweep.parent_id) == ("segmentation (2 jobs)", "KILLED", None)
    assert sweep.tags == {"host": "h", "ctus.kind": "sweep"}
    assert (sweep.start_ms, sweep.end_ms, sweep.params) == (3, 20, {"fold": "0"})
    # a run above that stands in another experiment is there
    assert runs["elsewhere"].experiment == "other" and len(runs) == 5
    # read and written again it is the same
    write_archive(list(runs.values()), tmp_path / "again")
    assert {run.run_id: run.tags for run in read_archive(tmp_path / "again")} == {
        name: run.tags for name, run in runs.items()
    }


def test_all_metrics_are_kept_and_archives_without_them_are_read(tmp_path: Path) -> None:
    metrics = {"dsc_mean": 0.5, "hd95_px_p95": float("inf")}
    write_archive([dataclasses.replace(record("new"), metrics=metrics)], tmp_path)
    assert [run.metrics for run in read_archive(tmp_path)] == [metrics]
    # a run that has lost its files keeps what an earlier export has of it
    write_archive([record("new")], tmp_path)
    assert [run.metrics for run in read_archive(tmp_path)] == [metrics]
    table = tmp_path / "segmentation" / "runs.parquet"
    pd.read_parquet(table).drop(columns="metrics").to_parquet(table, index=False)
    assert [run.metrics for run in read_archive(tmp_path)] == [{}]
    write_archive([dataclasses.replace(record("more"), metrics=metrics)], tmp_path)
    assert {run.run_id: run.metrics for run in read_archive(tmp_path)} == {"new": {}, "more": metrics}


def test_data_sets_are_kept_without_folders_and_archives_without_them_are_read(tmp_path: Path) -> None:
    used = (InputData("usgra", "abc", "/home/someone/usgra"),)
    write_archive([dataclasses.replace(record("new"), inputs=used)], tmp_path)
    shared = (InputData("usgra", "abc", ".../usgra"),)
    assert [run.inputs for run in read_archive(tmp_path)] == [shared]
    write_archive([record("new")], tmp_path)
    assert [run.inputs for run in read_archive(tmp_path)] == [shared]
    table = tmp_path / "segmentation" / "runs.parquet"
    whole = pd.read_parquet(table)
    whole.drop(columns="inputs").to_parquet(table, index=False)
    assert [run.inputs for run in read_archive(tmp_path)] == [()]
    whole.assign(inputs='["usgra"]').to_parquet(table, index=False)
    with pytest.raises(InputError, match="expected the fields of an exported run"):
        list(read_archive(tmp_path))


def test_paths_within_the_project_start_there_and_others_are_cut(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CTUS_HOME", "/home/me/project")
    text = "target=/home/me/project/outputs/a/model.ply,/data/home/me/project/b.ply sqlite:////home/me/project/x.db"
    assert without_folders(text) == "target=outputs/a/model.ply,.../b.ply sqlite:///.../x.db"
    assert without_folders(without_folders(text)) == without_folders(text)
    assert without_folders("root: /home/me/project") == "root: .../project"
    assert without_folders("root: /home/me/projects/a") == "root: .../a"


def test_a_second_export_replaces_its_runs_and_keeps_the_others(tmp_path: Path) -> None:
    write_archive([record("one"), record("two")], tmp_path)
    write_archive([record("two", value=0.9)], tmp_path)
    found = {run.run_id: run for run in read_archive(tmp_path)}
    assert set(found) == {"one", "two"}
    assert found["one"].history["value"].tolist() == [0.5, 1.0]
    assert found["two"].history["value"].tolist() == [0.5, 0.9]


@pytest.mark.parametrize(
    ("text", "shared"),
    [
        ("/data/usgra", ".../usgra"),
        ("of 3 in /home/a, 1 is new", "of 3 in .../a, 1 is new"),
        ("cache: '/srv/x/.cache/phantom'\nroot: /mnt/d/e\n", "cache: '.../phantom'\nroot: .../e\n"),
        ("[/a/b, /c/d/e]", "[.../b, .../e]"),
        ("results/runs", "results/runs"),
        ("https://host/a/b", "https://host/a/b"),
        ("sqlite:////srv/mlruns/ctus.db", "sqlite:///.../ctus.db"),
        ("1/2 of 3", "1/2 of 3"),
        ("/tmp", "/tmp"),
    ],
)
def test_folders_of_a_machine_are_cut_to_their_last_part(text: str, shared: str) -> None:
    assert without_folders(text) == shared


def test_an_archive_names_no_folder_of_the_machine(tmp_path: Path) -> None:
    named = dataclasses.replace(
        record("one"),
        params={"root": "/srv/data/usgra"},
        tags={"ctus.error": "no file /srv/data/x.png"},
        config="root: /srv/data/usgra\n",
    )
    write_archive([named], tmp_path)
    (found,) = read_archive(tmp_path)
    assert found.params == {"root": ".../usgra"}
    assert found.tags == {"ctus.error": "no file .../x.png"}
    assert found.config == "root: .../usgra\n"


NAMES = [
    "/x",
    "team/x",
    "../up",
    "..",
    ".",
    ".hidden",
    " x ",
    "a%2Fb",
    "a\\b",
    "con/..",
    "x" * 400,
    "\u00e4" * 90,
]


def test_experiments_of_any_name_stay_inside_the_archive_and_keep_it(tmp_path: Path) -> None:
    archive = tmp_path / "around" / "archive"
    records = [
        dataclasses.replace(record(f"run{number}"), experiment=name) for number, name in enumerate(NAMES)
    ]
    assert write_archive(records, archive) == len(NAMES)
    assert [path.name for path in (tmp_path / "around").iterdir()] == ["archive"]
    assert len(list(archive.iterdir())) == len(NAMES)
    assert all((path / "runs.parquet").is_file() for path in archive.iterdir())
    assert {run.experiment: run.run_id for run in read_archive(archive)} == {
        name: f"run{number}" for number, name in enumerate(NAMES)
    }
    assert [run.experiment for run in read_archive(archive, ["../up"])] == ["../up"]


def test_experiments_of_odd_names_survive_export_and_import(home: Path, tmp_path: Path) -> None:
    for name in ("/x", "team/x", "../up"):
        run = Store().start(name, "r", {"ctus.kind": "job"})
        run.text("a: 1\n", "config.yaml")
        run.end("FINISHED")
    archive = tmp_path / "archive"
    assert main(["study=export_runs", f"archive={archive}"]) == 0
    assert sorted(path.name for path in archive.iterdir()) == ["%2E.%2Fup", "%2Fx", "team%2Fx"]
    other = Store(uri=f"sqlite:///{tmp_path / 'other.db'}")
    assert main(["study=import_runs", f"archive={archive}", f"tracking.uri={other.address}"]) == 0
    names = {experiment.name for experiment in other.client().search_experiments()}
    assert {"/x", "team/x", "../up"} <= names
    (one,) = other.runs(["../up"])
    assert one.info.status == "FINISHED"


@pytest.mark.parametrize(
    ("column", "value", "sentence"),
    [
        ("run_id", "../../../evil", "expected run ids of letters, digits, - and _, received '../../../evil'"),
        ("run_id", "/etc/passwd", "received '/etc/passwd'"),
        ("status", "RUNNING", "expected runs that ended (FINISHED, FAILED, KILLED), found 'RUNNING'"),
        ("tags", "not json", "expected the fields of an exported run, found"),
        ("tags", "[1]", "expected the fields of an exported run, found"),
        ("params", '{"a": 1}', "expected the fields of an exported run, found"),
        ("name", None, "expected the fields of an exported run, found"),
    ],
)
def test_an_archive_that_says_what_it_must_not_is_refused(
    tmp_path: Path, column: str, value: object, sentence: str
) -> None:
    write_archive([record("one")], tmp_path)
    path = tmp_path / "segmentation" / "runs.parquet"
    pd.read_parquet(path).assign(**{column: value}).to_parquet(path)
    with pytest.raises(InputError) as refusal:
        list(read_archive(tmp_path))
    assert f"{path}: " in str(refusal.value)
    assert sentence in str(refusal.value)


def test_a_run_that_claims_a_place_outside_is_not_exported(home: Path, tmp_path: Path) -> None:
    run = Store().start("segmentation", "r", {ORIGIN_TAG: "../../evil"})
    run.text("a: 1\n", "config.yaml")
    run.end("FINISHED")
    assert main(["study=export_runs", f"archive={tmp_path / 'archive'}"]) == 2
    assert not (tmp_path / "archive").exists()


def test_files_that_are_no_tables_are_refused_by_name(tmp_path: Path) -> None:
    write_archive([record("one")], tmp_path)
    for name, wrong in (("history.parquet", b"no table"), ("cases/one.parquet", b"PAR1")):
        path = tmp_path / "segmentation" / name
        whole = path.read_bytes()
        path.write_bytes(wrong)
        with pytest.raises(InputError, match=f"{name}: expected a table of exported runs"):
            list(read_archive(tmp_path))
        path.write_bytes(whole)
    path = tmp_path / "segmentation" / "runs.parquet"
    pd.read_parquet(path).drop(columns="tags").to_parquet(path)
    with pytest.raises(InputError, match="found no tags"):
        list(read_archive(tmp_path))


def test_runs_that_lost_their_files_keep_what_was_exported_before(
    counting_study: ModuleType, home: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import shutil

    assert main(["study=counting"]) == 0
    assert main(["study=export_runs"]) == 0
    archive = home / "results" / "runs"
    before = {run.run_id: run for run in read_archive(archive)}
    shutil.rmtree(home / "mlruns" / "artifacts")
    capsys.readouterr()
    assert main(["study=export_runs"]) == 0
    assert "3 of them have no files where the tracker says they are" in capsys.readouterr().out
    after = {run.run_id: run for run in read_archive(archive)}
    assert {run: one.config for run, one in after.items()} == {run: one.config for run, one in before.items()}
    assert all(one.cases is not None for one in after.values())


def test_of_a_run_that_is_there_twice_the_finished_one_is_kept(tmp_path: Path) -> None:
    lost = dataclasses.replace(record("one", value=0.1), status="FAILED")
    for order in ([lost, record("one")], [record("one"), lost]):
        write_archive(order, tmp_path)
        (found,) = read_archive(tmp_path)
        assert found.status == "FINISHED"


def test_an_imported_sweep_keeps_its_family_when_it_is_exported_again(
    counting_study: ModuleType, home: Path, tmp_path: Path
) -> None:
    assert main(["study=counting"]) == 0
    assert main(["study=export_runs", f"archive={tmp_path / 'one'}"]) == 0
    other = f"tracking.uri=sqlite:///{tmp_path / 'other.db'}"
    assert main(["study=import_runs", f"archive={tmp_path / 'one'}", other]) == 0
    assert main(["study=export_runs", f"archive={tmp_path / 'two'}", other]) == 0
    families = [
        {run.run_id: run.parent_id for run in read_archive(tmp_path / name)} for name in ("one", "two")
    ]
    assert families[0] == families[1]
    tags = [{run.run_id: run.tags for run in read_archive(tmp_path / name)} for name in ("one", "two")]
    assert tags[0] == tags[1]


def test_an_empty_folder_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"expected exported runs .* found none"):
        list(read_archive(tmp_path))


def test_runs_survive_the_store_they_were_made_in(
    counting_study: ModuleType,
    home: Path,
    store_template: Path,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    assert main(["study=counting"]) == 0
    assert main(["study=export_runs"]) == 0
    before = {run.info.run_id: run for run in Store().runs(["counting"])}
    all_metrics = {run_id: Store().metrics(run_id) for run_id in before}
    fresh = tmp_path / "fresh"
    (fresh / "mlruns").mkdir(parents=True)
    (fresh / "mlruns" / "ctus.db").write_bytes((store_template / "ctus.db").read_bytes())
    monkeypatch.setenv("CTUS_HOME", str(fresh))

    assert main(["study=import_runs", f"archive={home / 'results' / 'runs'}"]) == 0
    assert main(["study=import_runs", f"archive={home / 'results' / 'runs'}"]) == 0  # adds nothing

    store = Store()
    after = {run.data.tags[ORIGIN_TAG]: run for run in store.runs(["counting"])}
    assert set(after) == set(before)
    for origin, run in after.items():
        old = before[origin]
        assert run.data.metrics == old.data.metrics
        assert run.data.params == old.data.params
        assert store.metrics(run.info.run_id) == pytest.approx(all_metrics[origin], nan_ok=True)
        assert (run.info.status, run.info.start_time, run.info.end_time, run.info.run_name) == (
            old.info.status, old.info.start_time, old.info.end_time, old.info.run_name
        )  # fmt: skip
        if PARENT_TAG in old.data.tags:
            assert run.data.tags[PARENT_TAG] == after[old.data.tags[PARENT_TAG]].info.run_id
            cases = store.cases(run.info.run_id)
            assert cases is not None
            assert len(cases) == 3
    # A restored run counts as done: nothing is computed again.
    counting_study.calls.clear()
    assert main(["study=counting", "resume=true"]) == 0
    assert counting_study.calls == []


@pytest.mark.parametrize("stopped_at", range(5))
def test_an_export_that_is_killed_leaves_the_archive_as_it_was_or_as_it_becomes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stopped_at: int
) -> None:
    write_archive([record("a"), record("b")], tmp_path)
    real, written = pd.DataFrame.to_parquet, []

    def stop(self: pd.DataFrame, path: Path, **named: object) -> None:
        written.append(path)
        if len(written) > stopped_at:
            Path(path).write_bytes(b"PAR1 half")
            raise KeyboardInterrupt
        real(self, path, **named)

    monkeypatch.setattr(pd.DataFrame, "to_parquet", stop)
    try:
        write_archive([record("b", value=2.0), record("c", value=3.0)], tmp_path)
    except KeyboardInterrupt:
        assert stopped_at < 4
    runs = {run.run_id: run for run in read_archive(tmp_path)}
    assert {"a", "b"} <= set(runs)
    assert ("c" in runs) == (stopped_at >= 4)
    for run in runs.values():
        assert len(run.history) == 2
        assert run.cases is not None
    assert runs["a"].history["value"].tolist() == [0.5, 1.0]
