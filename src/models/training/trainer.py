"""Lightning's trainer set up for one fold, and the switches of torch that are set while it runs."""

from __future__ import annotations

import contextlib
import logging
import os
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import torch
from lightning.pytorch import Callback, LightningDataModule, LightningModule, Trainer
from lightning.pytorch.plugins.environments import LightningEnvironment
from lightning.pytorch.strategies import DDPStrategy

from models.training.settings import TrainerSettings


def lightning_trainer(settings: TrainerSettings, callback: Callback, epochs: int, directory: Path) -> Trainer:
    """Set up a trainer that writes, logs and stops nothing by itself: that is left to ``callback``.

    With several devices it is the trainer of one process, which ``models.training.distributed`` has started and given
    its number.

    Parameters
    ----------
    settings : TrainerSettings
        Device, precision and gradient clipping.
    callback : Callback
        Callback that seeds, records and stops the training.
    epochs : int
        Number of epochs to train.
    directory : Path
        Lightning's default folder, to which nothing is written.

    Returns
    -------
    Trainer
        Lightning's trainer.
    """
    return Trainer(
        accelerator=settings.accelerator,
        devices=settings.devices,
        strategy=_strategy(settings),
        precision=settings.precision,
        max_epochs=epochs,
        gradient_clip_val=settings.gradient_clip,
        callbacks=[callback],
        # One process, wherever it was started: without this, Lightning takes over the signals of a Slurm job.
        plugins=[LightningEnvironment()],
        default_root_dir=directory,
        logger=False,
        enable_checkpointing=False,
        enable_progress_bar=False,
        enable_model_summary=False,
        num_sanity_val_steps=0,
        use_distributed_sampler=False,
    )


def _strategy(settings: TrainerSettings) -> str | DDPStrategy:
    if settings.devices == 1:
        return "auto"
    backend = "gloo" if settings.accelerator == "cpu" else "nccl"
    return DDPStrategy(process_group_backend=backend)


def fit(trainer: Trainer, module: LightningModule, data: LightningDataModule) -> None:
    """Train; a keyboard interrupt stays one, which Lightning would turn into an exit with code 1.

    Parameters
    ----------
    trainer : Trainer
        Lightning's trainer.
    module : LightningModule
        Network to train.
    data : LightningDataModule
        Batches.

    Raises
    ------
    KeyboardInterrupt
        If the user stopped the training.
    """
    try:
        trainer.fit(module, datamodule=data)
    except SystemExit as ended:
        if isinstance(ended.__context__, KeyboardInterrupt):
            raise KeyboardInterrupt from ended
        raise


@contextlib.contextmanager
def reproducible(settings: TrainerSettings) -> Iterator[None]:
    """Set torch's switches for determinism; leave them, and torch's random stream, as they were.

    Parameters
    ----------
    settings : TrainerSettings
        Holds whether results must be deterministic.
    """
    deterministic = torch.are_deterministic_algorithms_enabled()
    warn_only = torch.is_deterministic_algorithms_warn_only_enabled()
    # Its class has the switch as a property that no type checker sees.
    memory: Any = torch.utils.deterministic
    fill, benchmark = memory.fill_uninitialized_memory, torch.backends.cudnn.benchmark
    with torch.random.fork_rng():
        try:
            # Not every operation has a deterministic kernel on a GPU; where there is none, torch warns.
            torch.use_deterministic_algorithms(
                settings.deterministic, warn_only=settings.accelerator != "cpu"
            )
            # No result comes from memory that was never written, so none need be written twice.
            memory.fill_uninitialized_memory = False
            torch.backends.cudnn.benchmark = not settings.deterministic
            if settings.deterministic:
                # What cuBLAS needs for it; read once, when it is first used.
                os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")
            yield
        finally:
            torch.use_deterministic_algorithms(deterministic, warn_only=warn_only)
            memory.fill_uninitialized_memory = fill
            torch.backends.cudnn.benchmark = benchmark


@contextlib.contextmanager
def quiet() -> Iterator[None]:
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
