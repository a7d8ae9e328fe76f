"""The study from folds to model file, on drawn vessels and networks of a few hundred weights."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch
from drawn_vessels import drawn_frames

from experiments.errors import InputError
from experiments.outcome import JobResult, Outcome, Silent
from experiments.splits.group_splits import GroupSplits
from experiments.splits.split_set import SplitSet
from experiments.studies import consolidation
from experiments.studies.consolidation import training as study_training
from models.errors import InputError as ModelsInputError
from models.labelled_frames import LabelledFrames
from models.model_file import SegmentationModel
from models.networks.attention_unet import AttentionUNet
from models.networks.unet import UNet
from models.postprocessing import PostprocessingGrid
from models.predictor import Predictor
from models.preprocessing.preprocessing import Preprocessing
from models.training.augmentation import Augmentation
from models.training.distillation import Distillation
from models.training.initialisation import SharedRandom
from models.training.losses import DiceCrossEntropy
from models.training.settings import TrainerSettings

SPLIT = GroupSplits(2, selection_share=0.35, test_share=0.2)
SETTINGS = {"margin": 0.01, "alpha": 0.05, "min_seeds": 3, "min_groups": 3, "calibration": "temperature_bias"}


@dataclasses.dataclass(frozen=True)
class Drawn:
    """A data set of drawn vessels; ``edit`` changes its frames."""

    edit: Callable[[LabelledFrames], LabelledFrames] | None = None
    name: str = "drawn"

    def __call__(self) -> LabelledFrames:
        frames = drawn_frames(32, size=(16, 16), per_group=2)
        # Every eighth frame has nothing to find.
        masks = [mask if index % 8 else np.zeros_like(mask) for index, mask in enumerate(frames.masks)]
        frames = dataclasses.replace(frames, masks=tuple(masks))
        return frames if self.edit is None else self.edit(frames)


def run_job(workspace: Path, **changes: Any) -> Outcome:
    workspace.mkdir(parents=True, exist_ok=True)
    arguments: dict[str, Any] = {
        **SETTINGS,
        "dataset": Drawn(),
        "split": SPLIT,
        "model": UNet(width=2, depth=2),
        "second": None,
        "preprocessing": Preprocessing(16),
        "trainer": TrainerSettings(max_epochs=1, batch_size=4, learning_rate=0.01, patience=1),
        "augmentation": Augmentation(),
        "loss": DiceCrossEntropy(),
        "init": SharedRandom(),
        "postprocessing": PostprocessingGrid(lows=(0.3, 0.5), highs=(0.3, 0.5, 0.7), min_areas_px=(0.0, 5.0)),
        "max_false_alarm_rate": None,
        "band_px": 1.0,
        "distilled": True,
        "distillation": Distillation(),
        "aligned": True,
        "statistics_cases": 4,
        "barrier_points": 3,
        "barrier_cases": 4,
        "outer_fold": None,
        "training_seed": 0,
        "progress": Silent(),
    }
    return consolidation.run(**{**arguments, **changes}, workspace=workspace)


@pytest.fixture(scope="module", autouse=True)
def project_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Where trainings keep their state."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("project")
        patch.setenv("CTUS_HOME", str(folder))
        yield folder


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Outcome]:
    """One job with a second network."""
    workspace = tmp_path_factory.mktemp("job")
    return workspace, run_job(workspace, second=AttentionUNet(width=2, depth=3))


def test_all_candidates_stand_side_by_side_on_the_test_cases(job) -> None:
    workspace, outcome = job
    table = outcome.tables["candidates"].set_index("model")
    assert set(table.index) == {
        *("mean fold", "best fold", "uniform", "uniform + batch norm", "greedy", "aligned"),
        *("distilled", "ensemble of folds", "ensemble of networks"),
    }
    held_out = set(SplitSet.read(workspace / "splits.json").splits[0].held_out)
    assert (table["cases"] == len(held_out)).all()
    scored = outcome.cases[outcome.cases["kind"] == "case"]
    assert set(scored.loc[scored["part"] == "test", "case_id"]) == held_out
    assert table.loc["ensemble of networks", "megabytes"] > table.loc["ensemble of folds", "megabytes"]
    assert table.loc["ensemble of folds", "megabytes"] == pytest.approx(2 * table.loc["uniform", "megabytes"])
    assert table[["dsc_mean", "hd95_mm_mean", "nll", "ece", "seconds_per_frame"]].notna().all().all()


def test_a_single_seed_leaves_the_ensemble_with_a_certificate_that_says_why(job) -> None:
    workspace, outcome = job
    model = SegmentationModel.load(workspace / "model.pt")
    assert len(model.members) == 2 and model.certificate["consolidated"] == "ensemble of folds"
    assert model.certificate["reason"].startswith("not certified: n = 1 seed,")
    assert model.data["drawn"]["licence"] == "none (simulated)"
    assert "not certified" in (workspace / "certificate.md").read_text(encoding="utf-8")
    assert outcome.metrics["certified"] == 0.0 and "dsc_mean" in outcome.metrics
    assert not (workspace / "scratch").exists()


def test_scores_are_those_of_the_model_file(job) -> None:
    workspace, outcome = job
    model = SegmentationModel.load(workspace / "candidates" / "uniform.pt")
    frames = Drawn()()
    scored = outcome.cases.query(
        "kind == 'case' and part == 'test' and model == 'uniform' and step == 'raw 0.5'"
    )
    place = {case: index for index, case in enumerate(frames.case_ids)}
    predictor = Predictor(model.members[0].network(), model.preprocessing)
    for row in scored.dropna(subset="dsc").to_dict("records"):
        index = place[row["case_id"]]
        mask = predictor(frames.images[index][None])[0]
        both = 2 * (mask & frames.masks[index]).sum() / (mask.sum() + frames.masks[index].sum())
        assert row["dsc"] == pytest.approx(both, abs=0.02)


def test_three_seeds_decide_together_and_leave_the_first_seeds_model(job, tmp_path: Path) -> None:
    workspace, outcome = job
    jobs = [
        JobResult(
            {**SETTINGS, "training_seed": seed, "outer_fold": None},
            {},
            outcome.cases.assign(seed=seed),
            workspace,
        )
        for seed in (2, 0, 1)
    ]
    # A uniform average that is better everywhere than the ensemble.
    for result in jobs:
        better = (result.cases["model"] == "uniform") & (result.cases["kind"] == "case")
        result.cases.loc[better, "dsc"] = result.cases.loc[better, "dsc"].clip(lower=0.99)
    summary = consolidation.summarise(jobs)
    for name, write in summary.files.items():
        write(tmp_path / name)
    model = SegmentationModel.load(tmp_path / "model.pt")
    assert model.certificate["consolidated"] == "uniform" and model.certificate["certified"]
    assert [member.name for member in model.members] == ["uniform"] and model.certificate["seeds"] == 3
    assert "**uniform** (averaged network), certified." in (tmp_path / "certificate.md").read_text(
        encoding="utf-8"
    )
    assert summary.metrics["certified"] == 1.0
    assert summary.metrics["dsc_mean"] == pytest.approx(0.99, abs=0.01)


def test_choices_do_not_depend_on_the_test_labels(job, tmp_path: Path) -> None:
    workspace, outcome = job
    held_out = set(SplitSet.read(workspace / "splits.json").splits[0].held_out)

    def swapped(frames: LabelledFrames) -> LabelledFrames:
        masks = [
            np.flipud(np.roll(mask, 5, axis=1)) if case in held_out else mask
            for case, mask in zip(frames.case_ids, frames.masks, strict=True)
        ]
        return dataclasses.replace(frames, masks=tuple(np.ascontiguousarray(mask) for mask in masks))

    SPLIT_FILE = workspace / "splits.json"
    other = run_job(
        tmp_path,
        dataset=Drawn(swapped),
        split=GroupSplits(file=SPLIT_FILE),
        second=AttentionUNet(width=2, depth=3),
    )
    ours, theirs = (SegmentationModel.load(each / "model.pt") for each in (workspace, tmp_path))
    assert ours.digest == theirs.digest
    for name in ("uniform", "greedy", "aligned", "distilled"):
        first, second = (
            SegmentationModel.load(each / "candidates" / f"{name}.pt") for each in (workspace, tmp_path)
        )
        assert first.digest == second.digest
    reason = [
        SegmentationModel.load(each / "model.pt").certificate["comparisons"] for each in (workspace, tmp_path)
    ]
    assert str(reason[0]) == str(reason[1])
    same = ["kind", "model", "case_id", "dsc"]
    chosen_on = [
        each.cases[each.cases["part"] == "selection"][same].reset_index(drop=True)
        for each in (outcome, other)
    ]
    pd.testing.assert_frame_equal(*chosen_on)
    assert not other.tables["candidates"]["dsc_mean"].equals(outcome.tables["candidates"]["dsc_mean"])


def test_finished_trainings_are_used_again(job, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from models.training import trainer

    def refuse(*_: object) -> None:
        raise AssertionError("a finished training was trained again")

    monkeypatch.setattr(trainer, "fit", refuse)
    workspace, _ = job
    run_job(tmp_path, second=AttentionUNet(width=2, depth=3))
    first, second = (SegmentationModel.load(each / "model.pt") for each in (workspace, tmp_path))
    assert first.digest == second.digest


def test_a_network_without_batch_statistics_says_so(tmp_path: Path) -> None:
    outcome = run_job(
        tmp_path, model=UNet(width=2, depth=2, normalisation="instance"), distilled=False, aligned=False
    )
    assert set(outcome.tables["candidates"]["model"]) == {
        *("mean fold", "best fold", "uniform", "greedy", "ensemble of folds"),
    }
    assert any(
        finding.startswith("uniform + batch norm: no batch statistics") for finding in outcome.findings
    )


def test_folds_from_other_starts_are_not_averaged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = study_training.train_folds

    def other_starts(*arguments: Any) -> study_training.TrainedFolds:
        found = real(*arguments)
        members = tuple(
            dataclasses.replace(each, start=str(place)) for place, each in enumerate(found.members)
        )
        return dataclasses.replace(found, members=members)

    monkeypatch.setattr("experiments.studies.consolidation.job.train_folds", other_starts)
    with pytest.raises(ModelsInputError, match="networks from different starts can't be averaged"):
        run_job(tmp_path, distilled=False)


def config(**changes: Any) -> dict[str, Any]:
    split = {
        "_target_": "experiments.splits.group_splits.GroupSplits",
        "folds": 2,
        "selection_share": 0.2,
        "test_share": 0.2,
    }
    dataset = {"_target_": "experiments.datasets.phantom.Phantom"}
    return {
        "split": split,
        "dataset": dataset,
        "seeds": [0, 1],
        "training_seed": None,
        "outer_fold": None,
        **changes,
    }


def test_jobs_are_all_seeds_and_outer_folds() -> None:
    assert consolidation.jobs(config()) == [{"training_seed": 0}, {"training_seed": 1}]
    assert consolidation.jobs(config(training_seed=1)) == [{"training_seed": 1}]
    nested: dict[str, Any] = {
        "_target_": "experiments.splits.group_splits.GroupSplits",
        "folds": 2,
        "outer_folds": 2,
    }
    nested["selection_share"] = 0.2
    assert consolidation.jobs(config(split=nested, training_seed=0)) == [
        {"training_seed": 0, "outer_fold": 0},
        {"training_seed": 0, "outer_fold": 1},
    ]
    for changes in ({"seeds": []}, {"seeds": [1, 1]}, {"training_seed": 7}):
        with pytest.raises(InputError, match=r"seeds: expected|training_seed: expected"):
            consolidation.jobs(config(**changes))


@pytest.mark.parametrize("missing", ["selection", "test"])
def test_a_split_without_groups_to_choose_or_to_score_is_refused_before_data_is_read(missing: str) -> None:
    split = {**config()["split"], f"{missing}_share": 0.0}
    with pytest.raises(InputError, match=rf"split: expected .* received none for {missing}"):
        consolidation.jobs(config(split=split))


def test_a_second_network_must_be_another_one() -> None:
    model = UNet(width=2, depth=2)
    arguments = {
        "dataset": Drawn(),
        "model": model,
        "preprocessing": Preprocessing(16),
        "init": SharedRandom(),
    }
    consolidation.check(**arguments, second=None, calibration="boundary")
    with pytest.raises(InputError, match="model@second: expected another network"):
        consolidation.check(**arguments, second=model, calibration="none")
    with pytest.raises(InputError, match="calibration: expected one of none, temperature"):
        consolidation.check(**arguments, second=None, calibration="isotonic")


def test_soft_targets_are_interpolated_and_masks_stay_binary() -> None:
    from models.training.augmentation import Flip

    images, targets = torch.rand(2, 1, 8, 8), torch.rand(2, 1, 8, 8)
    augmentation = Augmentation((Flip(probability=1.0),))
    moved = augmentation(images, targets, torch.Generator().manual_seed(0), binary=False)[1]
    torch.testing.assert_close(moved, targets.flip(-1), atol=1e-5, rtol=0)
    hard = augmentation(images, (targets > 0.5).float(), torch.Generator().manual_seed(0))[1]
    assert set(hard.unique().tolist()) <= {0.0, 1.0}
