import dataclasses
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
from drawn_vessels import drawn_frames

from experiments.errors import InputError
from experiments.outcome import CellResult, Outcome, Silent
from experiments.splits import Split
from experiments.studies import segmentation
from experiments.studies.segmentation_report import describe, pooled_metrics, spread, table
from models.augmentation import Augmentation
from models.checkpoint import Checkpoint
from models.errors import InputError as ModelInputError
from models.labelled_frames import LabelledFrames
from models.losses import DiceCrossEntropy
from models.predictor import Predictor
from models.trainer_settings import TrainerSettings
from models.unet import UNet

SOURCE = Path(__file__).resolve().parents[3] / "src"


@dataclasses.dataclass(frozen=True)
class Drawn:
    """A data set of drawn vessels."""

    spacing_mm: tuple[float, float] | None = (0.5, 0.25)
    name: str = "drawn"

    def __call__(self) -> LabelledFrames:
        return drawn_frames(27, spacing_mm=self.spacing_mm, empty=2)


class Counting(Silent):
    """Progress that remembers what went through it."""

    def __init__(self) -> None:
        self.seen: dict[str, tuple[int, int | None]] = {}

    def track(self, items: Iterable, description: str, total: int | None = None) -> Iterator:
        for number, item in enumerate(items, 1):
            self.seen[description] = (number, total)
            yield item


def run_fold(workspace: Path, fold: int = 0, **changes: object) -> Outcome:
    workspace.mkdir(parents=True, exist_ok=True)
    arguments = {
        "dataset": Drawn(),
        "model": UNet(width=4, depth=3),
        "trainer": TrainerSettings(
            max_epochs=3, batch_size=4, image_size_px=32, learning_rate=0.01, patience=3
        ),
        "augmentation": Augmentation(),
        "loss": DiceCrossEntropy(),
        "folds": 3,
        "seed": 0,
        "progress": Silent(),
    }
    return segmentation.run(**{**arguments, **changes}, fold=fold, workspace=workspace)


@pytest.fixture(scope="module")
def sweep(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[CellResult, Outcome]]:
    """All three folds, as the shell would run them."""
    results = []
    for cell in segmentation.cells({"folds": 3, "fold": None}):
        workspace = tmp_path_factory.mktemp("fold")
        outcome = run_fold(workspace, **cell)
        results.append((CellResult(cell, outcome.metrics, outcome.cases, workspace), outcome))
    return results


def test_cells_are_all_folds_or_the_one_named() -> None:
    assert segmentation.cells({"folds": 3, "fold": None}) == [{"fold": 0}, {"fold": 1}, {"fold": 2}]
    assert segmentation.cells({"folds": 3, "fold": 2}) == [{"fold": 2}]


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ({"folds": 1, "fold": None}, "folds: expected a whole number of at least 2, received 1"),
        ({"folds": "three"}, "folds: expected a whole number of at least 2, received 'three'"),
        ({"folds": 3, "fold": 3}, "fold: expected 0 to 2, or null for all, received 3"),
        ({"folds": 3, "fold": True}, "fold: expected 0 to 2"),
    ],
)
def test_refuses_folds_that_are_none(config: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        segmentation.cells(config)


def test_a_missing_folder_is_refused_once_before_any_fold(tmp_path) -> None:
    node = {"_target_": "experiments.datasets.usgra.Usgra", "root": str(tmp_path / "none")}
    with pytest.raises(InputError, match=r"expected the folder of data set usgra .* pass dataset\.root="):
        segmentation.cells({"folds": 3, "fold": None, "dataset": node})
    (tmp_path / "none").mkdir()
    assert len(segmentation.cells({"folds": 3, "fold": None, "dataset": node})) == 3


def test_every_case_is_scored_once_by_a_network_that_has_not_seen_it(sweep) -> None:
    frames = Drawn()()
    cases = pd.concat([outcome.cases for _, outcome in sweep])
    assert sorted(cases["case_id"]) == sorted(frames.case_ids)
    for result, outcome in sweep:
        split = Split.read(result.workspace / "split.json")
        assert split.fold == result.config["fold"]
        assert list(outcome.cases["case_id"]) == list(split.test)
        seen = {split.groups[case] for case in (*split.train, *split.validation)}
        assert not seen & set(outcome.cases["group"])


def test_the_table_is_what_the_saved_network_scores_at_native_resolution(sweep) -> None:
    frames = Drawn()()
    result, outcome = sweep[1]
    predictor = Predictor.load(result.workspace / "model.pt")
    for row in outcome.cases.itertuples():
        index = frames.case_ids.index(row.case_id)
        predicted, reference = predictor(frames.images[index][None])[0], frames.masks[index]
        if reference.any():
            overlap = 2 * (predicted & reference).sum() / (predicted.sum() + reference.sum())
            assert row.dsc == pytest.approx(overlap)
            assert np.isfinite(row.hd95_mm)
        else:
            assert np.isnan(row.dsc) and row.false_alarm == float(predicted.any())


def test_columns_and_labels_of_the_table(sweep) -> None:
    cases = sweep[0][1].cases
    assert list(cases.columns[:7]) == ["case_id", "group", "fold", "model", "dataset", "seed", "simulated"]
    assert {"dsc", "hd95_mm", "hd95_surfel_mm", "missed", "false_alarm"} <= set(cases.columns)
    assert not [column for column in cases.columns if column.endswith("_px")]
    assert cases["model"].unique() == ["unet"] and cases["dataset"].unique() == ["drawn"]
    assert cases["simulated"].all()


def test_metrics_history_figures_and_files_of_a_fold(sweep) -> None:
    result, outcome = sweep[0]
    assert outcome.metrics["dsc_mean"] == pytest.approx(outcome.cases["dsc"].mean())
    assert outcome.metrics["dsc_n"] == outcome.cases["dsc"].notna().sum()
    assert outcome.metrics["epochs"] == len(outcome.history) == 3
    assert {"train_loss", "validation_loss", "validation_dsc", "learning_rate"} <= set(outcome.history[0])
    assert set(outcome.figures) == {"training_curves", "overlays"}
    assert sorted(path.name for path in result.workspace.iterdir()) == ["model.pt", "split.json"]
    assert outcome.tags == {"model": "unet", "dataset": "drawn", "simulated": "true"}
    assert outcome.inputs[0].digest == Drawn()().digest()
    for name, figure in outcome.figures.items():
        figure.savefig(result.workspace / f"{name}.svg")
        text = (result.workspace / f"{name}.svg").read_text()
        assert text.count("<path") > 10
        (result.workspace / f"{name}.svg").unlink()


def test_everything_shown_of_simulated_frames_says_so(sweep) -> None:
    for _, outcome in sweep:
        assert all("(simulated)" in finding for finding in outcome.findings)
        assert set(outcome.tables["segmentation"]["dataset"]) == {"drawn (simulated)"}
        assert all(
            "(simulated)" in figure.get_suptitle() + figure.get_supxlabel()
            for figure in outcome.figures.values()
        )


def test_summary_pools_the_cases_of_all_folds(sweep) -> None:
    summary = segmentation.summarise([result for result, _ in sweep])
    cases = pd.concat([outcome.cases for _, outcome in sweep])
    assert len(summary.cases) == 27
    assert summary.metrics["dsc_mean"] == pytest.approx(cases["dsc"].mean())
    assert summary.metrics["dsc_std"] == pytest.approx(cases["dsc"].std())
    shown = summary.tables["segmentation"]
    assert list(shown["fold"]) == ["0", "1", "2", "all"]
    for fold, (_, outcome) in enumerate(sweep):
        assert shown["dsc_mean"][fold] == pytest.approx(outcome.metrics["dsc_mean"])
        assert shown["hd95_mm_mean"][fold] == pytest.approx(outcome.metrics["hd95_mm_mean"])
    assert shown["dsc_mean"][3] == pytest.approx(cases["dsc"].mean())
    assert set(summary.figures) == {"spread"}


def test_folds_start_from_the_same_weights_and_runs_repeat_exactly(tmp_path) -> None:
    settings = TrainerSettings(
        max_epochs=1, batch_size=4, image_size_px=32, learning_rate=1e-12, patience=1, weight_decay=0.0
    )
    weights = [
        Checkpoint.load(run_path / "model.pt").weights["encoder.1.0.weight"]
        for run_path in (tmp_path / "0", tmp_path / "1")
        if run_fold(run_path, int(run_path.name), trainer=settings)
    ]
    torch.testing.assert_close(weights[0], weights[1], atol=1e-9, rtol=0)
    again = [run_fold(tmp_path / name) for name in ("a", "b")]
    first, second = (Checkpoint.load(tmp_path / name / "model.pt").weights for name in ("a", "b"))
    assert all(torch.equal(first[name], second[name]) for name in first)
    pd.testing.assert_frame_equal(again[0].cases, again[1].cases)
    other = run_fold(tmp_path / "c", seed=1)
    assert list(other.cases["case_id"]) != list(again[0].cases["case_id"])


def test_progress_counts_epochs_and_cases(tmp_path) -> None:
    progress = Counting()
    outcome = run_fold(tmp_path, fold=2, progress=progress)
    assert progress.seen == {
        "fold 2: epochs": (3, 3),
        "fold 2: cases": (len(outcome.cases), len(outcome.cases)),
    }


def test_without_spacing_distances_are_in_pixels(tmp_path) -> None:
    outcome = run_fold(tmp_path, dataset=Drawn(spacing_mm=None))
    assert "hd95_px" in outcome.cases and not [name for name in outcome.cases if name.endswith("_mm")]
    assert "hd95_px_mean" in outcome.metrics and "hd95_px_mean" in outcome.tables["segmentation"]
    assert "hd95_px" in outcome.findings[0]


def test_refuses_a_size_that_the_network_does_not_take(tmp_path) -> None:
    settings = TrainerSettings(max_epochs=1, batch_size=4, image_size_px=30, learning_rate=0.01, patience=1)
    with pytest.raises(ModelInputError, match="multiples of 4"):
        run_fold(tmp_path, trainer=settings)


def drawn_cases(**columns: object) -> pd.DataFrame:
    base = {
        "case_id": ["a", "b", "c", "d"],
        "fold": [0, 0, 1, 1],
        "model": ["unet"] * 4,
        "dataset": ["x"] * 4,
        "simulated": [False] * 4,
        "dsc": [0.5, 0.7, 0.0, np.nan],
        "hd95_px": [4.0, 6.0, 50.0, np.nan],
        "missed": [0.0, 0.0, 1.0, np.nan],
        "false_alarm": [np.nan, np.nan, np.nan, 1.0],
    }
    return pd.DataFrame({**base, **columns})


def test_table_of_known_numbers() -> None:
    shown = table(drawn_cases()).set_index("fold")
    assert shown.loc["0", "dsc_mean"] == pytest.approx(0.6)
    assert shown.loc["1", "dsc_mean"] == 0.0 and shown.loc["1", "missed_rate"] == 1.0
    assert shown.loc["all", "dsc_mean"] == pytest.approx(0.4)
    assert shown.loc["all", "hd95_px_mean"] == pytest.approx(20.0)
    assert shown.loc["all", "false_alarm_rate"] == 1.0 and np.isnan(shown.loc["0", "false_alarm_rate"])
    assert list(shown["cases"]) == [2, 2, 4]


def test_sentence_of_known_numbers() -> None:
    assert describe(drawn_cases()) == (
        "unet on x, fold 0, 1: mean DSC 0.400 and mean hd95_px 20.00 over 3 unseen cases with a vessel, "
        "1 of them missed; 1 false alarms in 1 without one.",
    )


def test_several_models_and_data_sets_are_kept_apart() -> None:
    cases = drawn_cases(
        model=["unet", "unet", "other", "other"], dataset=["x", "x", "x", "x"], simulated=[True] * 4
    )
    metrics = pooled_metrics(cases)
    assert metrics["unet/x/dsc_mean"] == pytest.approx(0.6) and metrics["other/x/dsc_mean"] == 0.0
    assert len(describe(cases)) == 2
    assert list(table(cases)["model"]) == ["unet", "other"]
    assert {text.get_text() for axes in spread(cases).axes for text in axes.get_xticklabels()} == {
        "unet\nx (simulated)",
        "other\nx (simulated)",
    }


def test_the_study_imports_at_once() -> None:
    code = (
        "import sys, experiments.studies.segmentation as s;"
        "late = {'torch', 'lightning', 'monai', 'matplotlib.pyplot', 'open3d', 'mlflow', 'sklearn'};"
        "print(sorted(late & set(sys.modules)))"
    )
    found = subprocess.run(
        [sys.executable, "-c", code],
        env={"PYTHONPATH": str(SOURCE), "PATH": ""},
        capture_output=True,
        text=True,
        check=True,
    )
    assert found.stdout.strip() == "[]"


def test_learns_real_vessels_in_a_few_epochs(real_data, tmp_path) -> None:
    from experiments.datasets.usgra import Usgra

    settings = TrainerSettings(max_epochs=3, batch_size=8, image_size_px=64, learning_rate=0.005, patience=3)
    outcome = run_fold(
        tmp_path, dataset=Usgra(str(real_data / "usgra")), model=UNet(width=4, depth=4), trainer=settings
    )
    assert outcome.metrics["dsc_n"] > 50
    assert outcome.history[-1]["train_loss"] < 0.9 * outcome.history[0]["train_loss"]
    assert "hd95_px" in outcome.cases and not outcome.cases["simulated"].any()
