"""Specification of a training, and its fingerprint."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import torch

from models.array_types import Float
from models.errors import InputError
from models.labelled_frames import LabelledFrames
from models.networks.blocks import require_size
from models.networks.registry import NetworkRecipe, settings_of
from models.preprocessing.preprocessing import Preprocessing
from models.processor import has_bfloat16_units
from models.training.augmentation import Augmentation
from models.training.initialisation import Initialisation, SharedRandom, Start
from models.training.losses import Loss
from models.training.settings import TrainerSettings
from models.training.training_data import TrainingData

# To be raised when a training of the same settings is no longer the same training.
VERSION = 3
# Settings of how far a training is continued, not of which one it is.
_HOW_FAR = ("resume", "extend_epochs")
# Settings that say nothing of a training on one device.
_OF_SEVERAL = ("devices", "strategy")


@dataclass(frozen=True)
class FoldTraining:
    """Specification of a training: one fold of one network on one data set, with one seed.

    Parameters
    ----------
    model : NetworkRecipe
        Architecture.
    train, validation : LabelledFrames
        Cases to train on and to select the best epoch by.
    preprocessing : Preprocessing
        What all frames go through.
    trainer : TrainerSettings
        Budget and optimisation.
    augmentation : Augmentation
        Random transforms of training batches.
    loss : Loss
        What training minimises.
    seed : int
        Seed of all random numbers.
    fold : int
        Number of the fold.
    initialisation : Initialisation, optional
        Weights to start from.
    data : tuple of TrainingData, optional
        Data sets that ``train`` and ``validation`` are from.
    targets : ndarray of float, shape (n, s, s), or None, optional
        Probabilities at the network's size that the training frames have in the place of masks: those of an ensemble
        that is distilled.

    Raises
    ------
    InputError
        If the network does not take the image size, if the start is of another architecture or has learnt from
        ``data``, if targets are of another size, if the training or validation frames show no vessel, or if GPUs
        are asked for that are not there.
    """

    model: NetworkRecipe
    train: LabelledFrames
    validation: LabelledFrames
    preprocessing: Preprocessing
    trainer: TrainerSettings
    augmentation: Augmentation
    loss: Loss
    seed: int
    fold: int
    initialisation: Initialisation = field(default_factory=SharedRandom)
    data: tuple[TrainingData, ...] = ()
    targets: Float[np.ndarray, "n s s"] | None = None

    def __post_init__(self) -> None:
        size = self.preprocessing.image_size_px
        require_size(size, size, self.model.multiple)
        for name, frames in (("train", self.train), ("validation", self.validation)):
            if not any(mask.any() for mask in frames.masks):
                raise InputError(
                    f"{name}: expected frames with a vessel, received {len(frames)} frames without any"
                )
        shape = (len(self.train), size, size)
        if self.targets is not None and self.targets.shape != shape:
            raise InputError(
                f"targets: expected probabilities of shape {shape}, received {self.targets.shape}"
            )
        self.initialisation.require_fit(self.model)
        self.initialisation.require_unseen(self.data)
        gpu = torch.cuda.is_available() or torch.backends.mps.is_available()
        if self.trainer.accelerator == "gpu" and not gpu:
            raise InputError("accelerator: expected a machine with a GPU, found none")
        several = self.trainer.devices
        if self.trainer.accelerator != "cpu" and several > max(1, torch.cuda.device_count()):
            raise InputError(
                f"devices: expected at most the {torch.cuda.device_count()} GPUs of CUDA that are visible, "
                f"received {several}"
            )
        on_cpu = self.trainer.accelerator == "cpu" or not gpu
        known = ("32-true", "bf16-mixed") if has_bfloat16_units() else ("32-true",)
        if on_cpu and self.trainer.precision not in known:
            raise InputError(
                f"precision: expected {' or '.join(known)} on this processor, which has no units for another, received "
                f"{self.trainer.precision!r}"
            )

    @cached_property
    def start(self) -> Start:
        """Weights that the training starts from."""
        return self.initialisation(self.model, self.seed)

    @property
    def learnt_from(self) -> tuple[TrainingData, ...]:
        """Data sets that the trained network has learnt from: those of its start, then its own."""
        return tuple(dict.fromkeys((*self.start.trained_on, *self.data)))

    @cached_property
    def fingerprint(self) -> str:
        """SHA-256 over the settings and every image and mask of either side: equal for the same training alone."""
        left_out = _HOW_FAR if self.trainer.devices > 1 else (*_HOW_FAR, *_OF_SEVERAL)
        budget = {key: value for key, value in vars(self.trainer).items() if key not in left_out}
        content = {
            "version": VERSION,
            "model": [self.model.name, settings_of(self.model)],
            "frames": [self.train.digest(), self.validation.digest()],
            "preprocessing": dataclasses.asdict(self.preprocessing),
            "trainer": budget,
            "augmentation": [[type(each).__name__, vars(each)] for each in self.augmentation.transforms],
            "loss": [type(self.loss).__name__, vars(self.loss)],
            "start": self.start.digest,
            "seed": [self.seed, self.fold],
        }
        if self.targets is not None:
            content["targets"] = hashlib.sha256(np.ascontiguousarray(self.targets).tobytes()).hexdigest()
        return hashlib.sha256(json.dumps(content, sort_keys=True, default=repr).encode()).hexdigest()
