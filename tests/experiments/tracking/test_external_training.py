"""A training from a machine without the tracker becomes a run, once."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
import pytest

from experiments.cli import main
from experiments.errors import InputError
from experiments.tracking import Store
from experiments.tracking.external_training import read_training


@pytest.fixture
def training(tmp_path: Path) -> Path:
    folder = tmp_path / "training"
    folder.mkdir()
    (folder / "model.pt").write_bytes(b"weights")
    (folder / "metrics.json").write_text(
        json.dumps({"dsc_mean": 0.8, "hd95_mm_mean": None, "training_s": 5.0})
    )
    (folder / "history.json").write_text(json.dumps([{"loss": 1.0}, {"loss": 0.5, "validation_dsc": 0.7}]))
    (folder / "config.yaml").write_text("model:\n  name: unet\n  width: 8\nseed: 3\n")
    cases = pd.DataFrame(
        {"case_id": ["a", "b"], "fold": 1, "model": "unet", "dataset": "usgra", "dsc": [0.7, 0.9]}
    )
    cases.to_csv(folder / "cases.csv", index=False)
    return folder


def test_a_training_becomes_one_run_however_often_it_is_imported(training: Path, home: Path) -> None:
    for _ in range(2):
        assert main(["study=import_runs", f"archive={training}"]) == 0
    store = Store()
    (run,) = store.runs(["segmentation"])
    assert run.data.metrics["dsc_mean"] == 0.8
    assert "hd95_mm_mean" not in run.data.metrics
    assert run.data.params == {"model": "unet", "dataset": "usgra", "width": "8", "seed": "3", "fold": "1"}
    assert [point.value for point in store.client().get_metric_history(run.info.run_id, "val_dsc")] == [0.7]
    assert store.metrics(run.info.run_id)["training_s"] == 5.0
    assert run.info.end_time - run.info.start_time == 5000
    assert [point.value for point in store.client().get_metric_history(run.info.run_id, "loss")] == [1.0, 0.5]
    cases = store.cases(run.info.run_id)
    assert cases is not None
    assert cases["dsc"].tolist() == [0.7, 0.9]


def test_names_of_cases_and_groups_are_text(training: Path) -> None:
    (training / "cases.csv").write_text(
        "case_id,group,fold,model,dataset,dsc\n010,1.10,1,unet,2024,0.5\nNA,null,1,unet,2024,\n"
    )
    cases = read_training(training).cases
    assert cases is not None
    assert cases["case_id"].tolist() == ["010", "NA"] and cases["group"].tolist() == ["1.10", "null"]
    assert cases["dataset"].tolist() == ["2024"] * 2 and cases["dsc"].isna().tolist() == [False, True]


def test_a_missing_or_broken_file_is_named(training: Path) -> None:
    (training / "metrics.json").write_text("{")
    with pytest.raises(InputError, match=r"metrics\.json: expected JSON"):
        read_training(training)
    (training / "cases.csv").unlink()
    with pytest.raises(InputError, match=r"found no cases\.csv"):
        read_training(training)
