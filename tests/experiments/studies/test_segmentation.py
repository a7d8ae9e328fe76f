import dataclasses
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
from drawn_vessels import drawn_frames

from experiments.analysis.segmentation.stored_predictions import StoredPredictions
from experiments.errors import InputError
from experiments.outcome import JobResult, Outcome, Silent
from experiments.splits.group_splits import GroupSplits
from experiments.splits.split import Split
from experiments.studies import segmentation
from models.checkpoint import Checkpoint
from models.errors import InputError as ModelInputError
from models.labelled_frames import LabelledFrames
from models.networks.unet import UNet
from models.predictor import Predictor
from models.preprocessing.preprocessing import Preprocessing
from models.training.augmentation import Augmentation
from models.training.initialisation import SharedRandom
from models.training.losses import DiceCrossEntropy
from models.training.settings import TrainerSettings

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
        "preprocessing": Preprocessing(32),
        "trainer": TrainerSettings(max_epochs=3, batch_size=4, learning_rate=0.01, patience=3),
        "augmentation": Augmentation(),
        "loss": DiceCrossEntropy(),
        "init": SharedRandom(),
        "split": GroupSplits(3),
        "outer_fold": None,
        "seed": 0,
        "progress": Silent(),
    }
    return segmentation.run(**{**arguments, **changes}, fold=fold, workspace=workspace)


@pytest.fixture(scope="module", autouse=True)
def project_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Where trainings keep their state."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("project")
        patch.setenv("CTUS_HOME", str(folder))
        yield folder


@pytest.fixture(scope="module")
def sweep(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[JobResult, Outcome]]:
    """All three folds, as the sweep runner would run them."""
    results = []
    for job in segmentation.jobs(config()):
        workspace = tmp_path_factory.mktemp("fold")
        outcome = run_fold(workspace, **job)
        results.append((JobResult(job, outcome.metrics, outcome.cases, workspace), outcome))
    return results


def config(**changes: object) -> dict[str, object]:
    split = {"_target_": "experiments.splits.group_splits.GroupSplits", "folds": 3}
    dataset = {"_target_": "experiments.datasets.phantom.Phantom"}
    return {"split": split, "dataset": dataset, "outer_fold": None, "fold": None, **changes}


def test_jobs_are_all_folds_or_the_one_named() -> None:
    assert segmentation.jobs(config()) == [{"fold": 0}, {"fold": 1}, {"fold": 2}]
    assert segmentation.jobs(config(fold=2)) == [{"fold": 2}]


def test_jobs_of_nested_folds() -> None:
    split = {"_target_": "experiments.splits.group_splits.GroupSplits", "folds": 2, "outer_folds": 3}
    pairs = [{"outer_fold": outer, "fold": fold} for outer in range(3) for fold in range(2)]
    assert segmentation.jobs(config(split=split)) == pairs
    assert segmentation.jobs(config(split=split, outer_fold=1)) == pairs[2:4]
    assert segmentation.jobs(config(split=split, outer_fold=2, fold=0)) == pairs[4:5]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fold": 3}, "fold: expected 0 to 2, or null for all, received 3"),
        ({"fold": True}, "fold: expected 0 to 2, or null for all, received True"),
        ({"fold": "first"}, "fold: expected 0 to 2, or null for all, received 'first'"),
        ({"outer_fold": 0}, "outer_fold: expected null, as the split has no outer folds, received 0"),
    ],
)
def test_refuses_folds_that_are_none(changes: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        segmentation.jobs(config(**changes))


def test_a_missing_folder_is_refused_once_before_any_fold(tmp_path) -> None:
    node = {"_target_": "experiments.datasets.usgra.Usgra", "root": str(tmp_path / "none")}
    with pytest.raises(InputError, match=r"expected the folder of data set usgra .* pass dataset\.root="):
        segmentation.jobs(config(dataset=node))
    (tmp_path / "none").mkdir()
    assert len(segmentation.jobs(config(dataset=node))) == 3


def test_an_image_size_that_does_not_fit_is_refused_before_any_fold() -> None:
    parts = {"dataset": Drawn(), "model": UNet(width=4, depth=3), "init": SharedRandom()}
    segmentation.check(**parts, preprocessing=Preprocessing(32))
    with pytest.raises(ModelInputError, match="image size: expected sides that are multiples of 4"):
        segmentation.check(**parts, preprocessing=Preprocessing(30))


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
    about = ["case_id", "group", "fold", "model", "dataset", "seed", "part", "simulated"]
    assert list(cases.columns[:8]) == about and set(cases["part"]) == {"out_of_fold"}
    assert {"dsc", "hd95_mm", "hd95_surfel_mm", "missed", "false_alarm"} <= set(cases.columns)
    assert not [column for column in cases.columns if column.endswith("_px")]
    assert cases["model"].unique() == ["unet"] and cases["dataset"].unique() == ["drawn"]
    assert cases["simulated"].all()


def test_predictions_are_left_in_small_and_read_back_at_native_size(sweep) -> None:
    frames = Drawn()()
    for result, outcome in sweep:
        stored = StoredPredictions.open(result.workspace / "predictions.zip")
        assert stored.of("out_of_fold") == tuple(outcome.cases["case_id"])
        assert stored.about["fold"] == result.config["fold"] and stored.about["model"] == "unet"
        predictor = Predictor.load(result.workspace / "model.pt")
        for case, row in stored.cases.items():
            index = frames.case_ids.index(case)
            image = frames.images[index][None]
            assert np.array_equal(stored.mask(case), predictor(image)[0])
            expected = predictor.probability(image)[0]
            np.testing.assert_allclose(stored.probability(case), expected, atol=0.002)
            assert row["group"] == frames.groups[index]


def test_cases_outside_all_folds_are_scored_and_never_pooled(tmp_path) -> None:
    split = GroupSplits(3, selection_share=0.2, test_share=0.2)
    outcome = run_fold(tmp_path, split=split)
    own = Split.read(tmp_path / "split.json")
    parts = {part: list(cases["case_id"]) for part, cases in outcome.cases.groupby("part")}
    assert {part: sorted(cases) for part, cases in parts.items()} == {
        "out_of_fold": sorted(own.test),
        "selection": sorted(own.selection),
        "held_out": sorted(own.held_out),
    }
    of = outcome.cases.set_index("case_id")["dsc"]
    assert outcome.metrics["dsc_mean"] == pytest.approx(of[list(own.test)].mean())
    assert outcome.metrics["held_out_dsc_mean"] == pytest.approx(of[list(own.held_out)].mean())
    stored = StoredPredictions.open(tmp_path / "predictions.zip")
    assert sorted(stored.of("selection")) == sorted(own.selection)
    summary = segmentation.summarise([JobResult(config(), outcome.metrics, outcome.cases, tmp_path)])
    assert sorted(summary.cases["case_id"]) == sorted(own.test)
    assert summary.metrics["dsc_mean"] == pytest.approx(of[list(own.test)].mean())
    outside = summary.tables["outside all folds"].set_index("part")
    assert outside["dsc_mean"]["selection"] == pytest.approx(of[list(own.selection)].mean())
    assert outside["cases"]["held_out"] == len(own.held_out)


def test_metrics_history_figures_and_files_of_a_fold(sweep) -> None:
    result, outcome = sweep[0]
    assert outcome.metrics["dsc_mean"] == pytest.approx(outcome.cases["dsc"].mean())
    assert outcome.metrics["dsc_n"] == outcome.cases["dsc"].notna().sum()
    assert outcome.metrics["epochs"] == len(outcome.history) == 3
    assert outcome.metrics["images_per_s"] > 0
    # A process with torch in it takes hundreds of megabytes.
    assert 100 < outcome.metrics["peak_memory_mb"] < 100_000
    assert {"train_loss", "validation_loss", "validation_dsc", "learning_rate"} <= set(outcome.history[0])
    assert set(outcome.figures) == {"training_curves", "overlays"}
    assert sorted(path.name for path in result.workspace.iterdir()) == [
        "model.pt",
        "predictions.zip",
        "split.json",
        "splits.json",
    ]
    digest = SharedRandom()(UNet(width=4, depth=3), 0).digest
    start = {"init": "shared_random", "start_source": "random weights of seed 0", "start": digest}
    assert outcome.tags == {"model": "unet", "dataset": "drawn", "simulated": "true", **start}
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
    shown = summary.tables["folds of drawn (simulated)"]
    assert list(shown["fold"]) == ["0", "1", "2", "all"]
    for fold, (_, outcome) in enumerate(sweep):
        assert shown["dsc_mean"][fold] == pytest.approx(outcome.metrics["dsc_mean"])
        assert shown["hd95_mm_mean"][fold] == pytest.approx(outcome.metrics["hd95_mm_mean"])
    assert shown["dsc_mean"][3] == pytest.approx(cases["dsc"].mean())
    assert set(summary.figures) == {"spread"}


def test_folds_start_from_the_same_weights_and_runs_repeat_exactly(tmp_path) -> None:
    settings = TrainerSettings(max_epochs=1, batch_size=4, learning_rate=1e-12, patience=1, weight_decay=0.0)
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
    other = run_fold(tmp_path / "c", seed=1, split=GroupSplits(3, seed=1))
    assert list(other.cases["case_id"]) != list(again[0].cases["case_id"])


class StoppingAfter(Silent):
    """Progress that stops the job after so many epochs."""

    def __init__(self, epochs: int) -> None:
        self.epochs = epochs

    def track(self, items: Iterable, description: str, total: int | None = None) -> Iterator:
        for number, item in enumerate(items):
            if "epochs" in description and number == self.epochs:
                raise KeyboardInterrupt
            yield item


def test_a_stopped_fold_goes_on_from_a_folder_that_outlives_its_workspace(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("CTUS_HOME", str(tmp_path / "home"))
    whole = run_fold(tmp_path / "whole")
    (kept,) = (tmp_path / "home" / ".cache" / "training").iterdir()
    monkeypatch.setenv("CTUS_HOME", str(tmp_path / "other"))
    with pytest.raises(KeyboardInterrupt):
        run_fold(tmp_path / "stopped", progress=StoppingAfter(2))
    shutil.rmtree(tmp_path / "stopped")
    (state,) = (tmp_path / "other" / ".cache" / "training").iterdir()
    assert state.name == kept.name
    done = torch.load(state / "state.pt", weights_only=True)["history"]
    assert 1 <= len(done) < 3
    trainer = TrainerSettings(max_epochs=3, batch_size=4, learning_rate=0.01, patience=3, resume=True)
    resumed = run_fold(tmp_path / "resumed", trainer=trainer)
    assert list(resumed.history[: len(done)]) == list(done)
    pd.testing.assert_frame_equal(resumed.cases, whole.cases)
    first, second = (Checkpoint.load(tmp_path / name / "model.pt").weights for name in ("whole", "resumed"))
    assert all(torch.equal(first[name], second[name]) for name in first)


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


def test_what_was_left_out_as_unpaired_stands_in_every_table_and_figure(tmp_path) -> None:
    @dataclasses.dataclass(frozen=True)
    class Incomplete(Drawn):
        def left_out(self) -> int:
            return 4

        def notes(self) -> tuple[str, ...]:
            return ("The copy is not whole.",)

    folds = [run_fold(tmp_path / str(fold), fold=fold, dataset=Incomplete()) for fold in (0, 1)]
    results = [
        JobResult(config(fold=fold), outcome.metrics, outcome.cases, tmp_path / str(fold))
        for fold, outcome in enumerate(folds)
    ]
    for outcome in (*folds, segmentation.summarise(results)):
        assert "drawn (4 unpaired left out)" in outcome.findings[0]
        assert outcome.findings.count("The copy is not whole.") == 1
        for name, table in outcome.tables.items():
            assert "4 unpaired left out" in f"{name} {table.get('dataset', pd.Series()).tolist()}"


def test_refuses_a_size_that_the_network_does_not_take(tmp_path) -> None:
    with pytest.raises(ModelInputError, match="multiples of 4"):
        run_fold(tmp_path, preprocessing=Preprocessing(30))


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

    settings = TrainerSettings(max_epochs=3, batch_size=8, learning_rate=0.005, patience=3)
    outcome = run_fold(
        tmp_path,
        dataset=Usgra(str(real_data / "usgra")),
        model=UNet(width=4, depth=4),
        preprocessing=Preprocessing(64),
        trainer=settings,
    )
    assert outcome.metrics["dsc_n"] > 50
    assert outcome.history[-1]["train_loss"] < 0.9 * outcome.history[0]["train_loss"]
    assert "hd95_px" in outcome.cases and not outcome.cases["simulated"].any()
