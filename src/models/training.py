"""Training of one fold: the same first weights for all folds, the best epoch's weights kept."""

from __future__ import annotations

import contextlib
import logging
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import nn

from models.augmentation import Augmentation
from models.blocks import require_size
from models.checkpoint import Checkpoint
from models.errors import InputError
from models.labelled_frames import LabelledFrames
from models.losses import DiceCrossEntropy
from models.networks import NetworkRecipe
from models.preprocessing import Preprocessing
from models.trainer_settings import TrainerSettings

if TYPE_CHECKING:
    from lightning.pytorch import Trainer

    from models.segmenter import EpochReports

# Purposes that random numbers are drawn for: each has a stream of its own under one seed.
WEIGHTS, TRAINING = 0, 1


@dataclass(frozen=True)
class TrainedFold:
    """Where the best weights lie, and how the training went: one mapping of measures for each epoch."""

    checkpoint: Path
    history: tuple[Mapping[str, float], ...]
    best_epoch: int
    best_validation_dsc: float
    runtime_s: float


def train_fold(
    *,
    model: NetworkRecipe,
    train: LabelledFrames,
    validation: LabelledFrames,
    trainer: TrainerSettings,
    augmentation: Augmentation,
    loss: DiceCrossEntropy,
    seed: int,
    fold: int,
    directory: Path,
    on_epoch: Callable[[Mapping[str, float]], None] | None = None,
) -> TrainedFold:
    """Train a network and keep the weights of the epoch with the best validation DSC in ``directory/model.pt``.

    The first weights depend on ``seed`` alone, the same for every fold; shuffling, augmentation and dropout depend on
    ``seed`` and ``fold``. ``on_epoch`` gets each epoch's measures. Raises InputError if the network doesn't take the
    image size, if the training or validation frames show no vessel, or if a GPU is asked for and there is none.
    """
    _check(model, train, validation, trainer)
    # Lightning takes seconds to import: whoever only wants the settings' classes should not wait for it.
    from models.datamodule import FoldData
    from models.segmenter import EpochReports, Segmenter

    start_s = time.perf_counter()
    preprocessing = Preprocessing(trainer.image_size_px)
    training_seed = seed_of(seed, TRAINING, fold)
    data = FoldData(train, validation, preprocessing, augmentation, trainer.batch_size, training_seed)
    module = Segmenter(initial_network(model, seed), loss, trainer, data.steps_per_epoch)
    path = directory / "model.pt"

    def save(network: nn.Module, epoch: int, dsc: float) -> None:
        notes = {"seed": seed, "fold": fold, "epoch": epoch, "validation_dsc": dsc}
        Checkpoint(model, network.state_dict(), preprocessing, notes).save(path)

    reports = EpochReports(save, on_epoch)
    with _reproducible(training_seed), _quiet():
        _lightning_trainer(trainer, reports, directory).fit(module, datamodule=data)
    return TrainedFold(
        path, tuple(reports.history), reports.best_epoch, reports.best_dsc, time.perf_counter() - start_s
    )


def initial_network(model: NetworkRecipe, seed: int) -> nn.Module:
    """The network with the weights that every fold starts from; torch's own random stream is left as it was."""
    with torch.random.fork_rng():
        torch.manual_seed(seed_of(seed, WEIGHTS))
        return model()


def seed_of(seed: int, *purpose: int) -> int:
    """A seed for one purpose, unlike those of other purposes or of other seeds, 0 included."""
    if seed < 0:
        raise InputError(f"seed: expected a number from 0, received {seed}")
    return int(np.random.SeedSequence([seed, *purpose]).generate_state(1, np.uint32)[0])


def _check(
    model: NetworkRecipe, train: LabelledFrames, validation: LabelledFrames, trainer: TrainerSettings
) -> None:
    if trainer.accelerator == "gpu" and not (torch.cuda.is_available() or torch.backends.mps.is_available()):
        raise InputError("accelerator: expected a machine with a GPU, found none")
    require_size(trainer.image_size_px, trainer.image_size_px, model.multiple)
    for name, frames in (("train", train), ("validation", validation)):
        if not any(mask.any() for mask in frames.masks):
            raise InputError(
                f"{name}: expected frames with a vessel, received {len(frames)} frames without any"
            )


def _lightning_trainer(settings: TrainerSettings, reports: EpochReports, directory: Path) -> Trainer:
    from lightning.pytorch import Trainer
    from lightning.pytorch.callbacks import EarlyStopping

    return Trainer(
        accelerator=settings.accelerator,
        devices=1,
        precision=settings.precision,
        max_epochs=settings.max_epochs,
        gradient_clip_val=settings.gradient_clip,
        # Not every operation has a deterministic kernel on a GPU; where there is none, torch warns.
        deterministic=True if settings.accelerator == "cpu" else "warn",
        callbacks=[EarlyStopping("validation_dsc", mode="max", patience=settings.patience), reports],
        default_root_dir=directory,
        logger=False,
        enable_checkpointing=False,
        enable_progress_bar=False,
        enable_model_summary=False,
        num_sanity_val_steps=0,
        use_distributed_sampler=False,
    )


@contextlib.contextmanager
def _reproducible(seed: int) -> Iterator[None]:
    """Seed what dropout draws from, and put back the seed and the switches that Lightning throws."""
    deterministic = torch.are_deterministic_algorithms_enabled()
    benchmark = torch.backends.cudnn.benchmark
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        try:
            yield
        finally:
            torch.use_deterministic_algorithms(deterministic)
            torch.backends.cudnn.benchmark = benchmark


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep Lightning's advice on hardware and workers out of the user's terminal."""
    logger = logging.getLogger("lightning.pytorch")
    level = logger.level
    logger.setLevel(logging.WARNING)
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", module="lightning.*")
            yield
    finally:
        logger.setLevel(level)
