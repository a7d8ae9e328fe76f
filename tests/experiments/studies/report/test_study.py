"""The report end to end on an archive: tables, figures, one page, and the same bytes from another store."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from types import SimpleNamespace

import pandas as pd
import pytest
from report_runs import runs as recorded
from run_families import job, trials

from experiments.cli import main
from experiments.errors import InputError
from experiments.outcome import Silent
from experiments.studies.report import run
from experiments.studies.report.sections import Source
from experiments.studies.report.study import slug
from experiments.tracking import Store
from experiments.tracking.archive import write_archive
from experiments.tracking.run_record import restore_run

# What trials of the study have besides errors.
COLUMNS = {
    "rotation": "any", "place": "whole", "angle_deg": 7.5, "angle_from_deg": 0.0, "angle_to_deg": 15.0,
    "translation_mm": 5.0, "tre_low_mm": 0.1, "tre_high_mm": 0.6, "verdict": "accepted",
}  # fmt: skip


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report")
    write_archive(recorded(), folder / "runs")
    (folder / "out").mkdir()
    run(
        runs=[],
        archive=str(folder / "runs"),
        out=None,
        store=Store(enabled=False),
        workspace=folder / "out",
        progress=Silent(),
    )
    return folder


def test_every_table_and_figure_is_there_in_all_formats(report: Path) -> None:
    out = report / "out"
    stems = {path.stem for path in (out / "tables").glob("*.csv")}
    assert {"published", "provenance", "jobs", "segmentation_carotid_segmentation"} <= stems
    assert {path.stem for path in (out / "tables").glob("*.md")} == stems
    assert {path.stem for path in (out / "tables").glob("*.tex")} == stems | {"report"}
    assert {path.name for path in (out / "figures").glob("*")} == {
        f"segmentation_carotid_spread.{kind}" for kind in ("png", "svg", "pdf")
    }
    assert (out / "index.html").is_file()


def test_each_number_leads_to_its_run_code_and_data(report: Path) -> None:
    published = pd.read_csv(report / "out" / "tables" / "published.csv").fillna("")
    (row,) = published[published["measured_on"] == "unet on carotid"].to_dict("records")
    assert (row["ours"], row["difference"], row["run"]) == ("91.4 %", "in range", "top00000")
    (origin,) = pd.read_csv(report / "out" / "tables" / "provenance.csv").to_dict("records")
    assert (origin["run"], origin["jobs"], origin["data"]) == ("top00000", "2 of 2", f"carotid {'d' * 12}")
    assert origin["config_hash"] == "c" * 12 and origin["commit"] == "a" * 12


def test_the_page_stands_alone_and_shows_hostile_names_as_text(report: Path) -> None:
    page = (report / "out" / "index.html").read_text()
    assert "<script>alert" not in page and "&lt;script&gt;alert(1)" in page
    assert "http://" not in page and "https://" not in page and 'src="data:image/png;base64,' in page
    assert "/home/someone" not in page


def test_the_same_runs_imported_elsewhere_give_the_same_tables(
    report: Path, home: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["study=import_runs", f"archive={report / 'runs'}"]) == 0
    out = tmp_path / "again"
    assert main(["study=report", f"out={out}"]) == 0
    tables = sorted((report / "out" / "tables").iterdir())
    assert [path.name for path in sorted((out / "tables").iterdir())] == [path.name for path in tables]
    for path in tables:
        assert (out / "tables" / path.name).read_bytes() == path.read_bytes(), path.name
    # A report of other runs leaves none of these behind, and nothing that it has not written.
    (out / "tables" / "mine.csv").write_text("kept")
    outside = tmp_path / "outside.csv"
    outside.write_text("kept")
    listed = json.loads((out / "job.json").read_text())
    assert "index.html" in listed["files"] and all((out / name).is_file() for name in listed["files"])
    listed["files"] += ["../outside.csv", "tables/../../outside.csv"]
    (out / "job.json").write_text(json.dumps(listed))
    shutil.rmtree(home / "mlruns")
    write_archive(
        [job("alone", None, {"study": "pipeline"}, {"tre_mm": 1.0}, experiment="pipeline")], tmp_path / "few"
    )
    words = ["study=report", f"archive={tmp_path / 'few'}", f"out={out}"]
    assert main(words) == 2
    assert "received " + str(out) + ", whose report shows 1 run that the archive" in capsys.readouterr().err
    assert (out / "tables" / "segmentation_carotid_segmentation.csv").is_file()
    assert main([*words, "replace=true"]) == 0
    assert main(words) == 0
    assert not (out / "tables" / "segmentation_carotid_segmentation.csv").exists()
    assert (out / "tables" / "mine.csv").is_file() and outside.is_file()


def test_a_store_and_its_archive_give_the_same_tables(home: Path, tmp_path: Path) -> None:
    """Surfaces of one file name in two folders of the project are two anatomies in both."""
    jobs = [
        job(
            f"job{number}",
            trials({"model": [1.0 + number, 3.0]}, "multistart").assign(**COLUMNS),
            {
                "target": f"{home}/outputs/{name}/model.ply",
                "rigid": {"multistart": {}},
                "call": {"command": f"ctus target={home}/outputs/{name}/model.ply dataset.root=/data/usgra"},
            },
            parent="top",
            experiment="robustness",
            tags={"ctus.label": f"target={home}/outputs/{name}/model.ply"},
        )
        for number, name in enumerate(("artery", "vein"))
    ]
    top = job("top", None, {}, experiment="robustness", tags={"ctus.kind": "sweep"})
    store = Store()
    parent = restore_run(store, top, None)
    for each in jobs:
        restore_run(store, each, parent)
    assert main(["study=report", f"out={tmp_path / 'store'}"]) == 0
    assert main(["study=export_runs", f"archive={tmp_path / 'runs'}"]) == 0
    assert main(["study=report", f"archive={tmp_path / 'runs'}", f"out={tmp_path / 'archive'}"]) == 0
    tables = sorted((tmp_path / "store" / "tables").iterdir())
    assert len(tables) > 10
    for path in tables:
        assert (tmp_path / "archive" / "tables" / path.name).read_bytes() == path.read_bytes(), path.name
        assert str(home) not in path.read_text() and "/data/" not in path.read_text()
    published = pd.read_csv(tmp_path / "store" / "tables" / "published.csv").fillna("")
    assert set(published.loc[published["run"] != "", "n"]) == {"2 anatomies"}


def test_a_password_of_the_store_stays_out_of_the_report() -> None:
    source = Source(SimpleNamespace(address="http://me:secret@host:5000"))  # type: ignore[arg-type]
    assert "secret" not in source.name and "host:5000" in source.name


def test_runs_are_a_list(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"runs: expected a list of ids"):
        run(
            runs="abc",
            archive=None,
            out=None,
            store=Store(enabled=False),
            workspace=tmp_path,
            progress=Silent(),
        )


def test_names_of_files_are_plain() -> None:
    assert slug("To the truth, simulated (Å)") == "to_the_truth_simulated_a"
    assert slug("血管") == "unnamed"
