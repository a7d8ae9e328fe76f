"""What the studies that train have in common: which folds are jobs, what tables call a network, how a fold went."""

from __future__ import annotations

from pathlib import Path

import pytest

from experiments.analysis.segmentation.fold_run import FoldRun, fold_jobs, training_metrics
from experiments.errors import InputError
from experiments.splits.group_splits import GroupSplits
from models.networks.monai_network import MonaiNetwork
from models.networks.registry import NetworkRecipe
from models.networks.unet import UNet
from models.preprocessing.preprocessing import Preprocessing
from models.training.augmentation import Augmentation
from models.training.fold import TrainedFold
from models.training.initialisation import SharedRandom
from models.training.losses import DiceCrossEntropy
from models.training.settings import TrainerSettings


@pytest.mark.parametrize(
    ("split", "outer_fold", "fold", "found"),
    [
        (GroupSplits(3), None, None, [{"fold": 0}, {"fold": 1}, {"fold": 2}]),
        (GroupSplits(3), None, 0, [{"fold": 0}]),
        (
            GroupSplits(2, outer_folds=2),
            1,
            None,
            [{"outer_fold": 1, "fold": 0}, {"outer_fold": 1, "fold": 1}],
        ),
        (
            GroupSplits(2, outer_folds=2),
            None,
            1,
            [{"outer_fold": 0, "fold": 1}, {"outer_fold": 1, "fold": 1}],
        ),
    ],
)
def test_the_folds_that_are_asked_for(
    split: GroupSplits, outer_fold: object, fold: object, found: list
) -> None:
    assert fold_jobs(split, outer_fold, fold) == found


@pytest.mark.parametrize(
    ("split", "outer_fold", "fold", "message"),
    [
        (GroupSplits(3), None, 3, "fold: expected 0 to 2, or null for all, received 3"),
        (GroupSplits(3), None, False, "fold: expected 0 to 2, or null for all, received False"),
        (GroupSplits(3), 0, None, "outer_fold: expected null, as the split has no outer folds, received 0"),
        (GroupSplits(2, outer_folds=3), 3, None, "outer_fold: expected 0 to 2, or null for all, received 3"),
    ],
)
def test_refuses_a_fold_that_is_none(
    split: GroupSplits, outer_fold: object, fold: object, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        fold_jobs(split, outer_fold, fold)


@pytest.mark.parametrize(
    ("model", "name"), [(UNet(width=8), "unet"), (MonaiNetwork("SegResNet", 8), "monai SegResNet")]
)
def test_the_name_of_a_network_in_tables(model: NetworkRecipe, name: str) -> None:
    trainer = TrainerSettings(max_epochs=1, batch_size=1, learning_rate=0.1, patience=1)
    run = FoldRun(
        model, Preprocessing(32), trainer, Augmentation(), DiceCrossEntropy(), SharedRandom(), seed=0, fold=0
    )
    assert run.model_name == name


def test_how_a_training_went() -> None:
    speeds, memories = (5.0, 9.0, 7.0), (300.0, 320.0, 310.0)
    history = tuple(
        {"images_per_s": speed, "peak_memory_mb": memory}
        for speed, memory in zip(speeds, memories, strict=True)
    )
    found = training_metrics(TrainedFold(Path("model.pt"), history, 1, 0.75, 12.5))
    assert found == {
        "validation_dsc_best": 0.75,
        "best_epoch": 1.0,
        "epochs": 3.0,
        "training_s": 12.5,
        "images_per_s": 7.0,
        "peak_memory_mb": 320.0,
    }


def test_a_smoke_training_is_called_so_wherever_the_network_is_named() -> None:
    settings = {"max_epochs": 1, "batch_size": 2, "learning_rate": 0.001, "patience": 1}
    parts = (UNet(width=4), Preprocessing(64), TrainerSettings(**settings, smoke=True), Augmentation())
    assert (
        FoldRun(*parts, DiceCrossEntropy(), SharedRandom(), seed=0, fold=0).model_name == "smoke-trained unet"
    )
