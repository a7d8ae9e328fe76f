"""The budget of a training: how long, how large, how fast. Free of torch, so that a configuration is read at once."""

from __future__ import annotations

import math
from dataclasses import dataclass

from models.errors import InputError
from models.training import schedules
from models.training.selection import EpochSelection

ACCELERATORS = ("cpu", "gpu", "auto")
LATE_WEIGHTS = ("none", "ema", "swa")
PRECISIONS = ("32-true", "16-mixed", "bf16-mixed")
STRATEGIES = ("auto", "ddp")
# Fraction of the highest learning rate that a finished training is extended with.
EXTENSION_FACTOR = 0.1


@dataclass(frozen=True)
class TrainerSettings:
    """Settings of a training with AdamW (Loshchilov and Hutter, ICLR 2019).

    Parameters
    ----------
    max_epochs : int
        Largest number of epochs.
    batch_size : int
        Number of images in a batch.
    learning_rate : float
        Highest learning rate.
    patience : int
        Number of epochs without a higher validation DSC (with ``selection`` ``smoothed``: its median) after which
        training stops.
    schedule : str
        ``cosine`` or ``one_cycle``.
    warmup_epochs : int or None
        Epochs in which the rate rises; None for one epoch of a cosine and 30 % of a cycle.
    weight_decay : float
        Weight decay of AdamW.
    gradient_clip : float
        Largest norm of the gradient.
    accelerator : str
        One of ``ACCELERATORS``.
    precision : str
        One of ``PRECISIONS``. On a CPU ``16-mixed`` is refused, and ``bf16-mixed`` is for one with units for it
        (``models.processor.has_bfloat16_units``); on others it is slower.
    deterministic : bool
        Whether the result is the same each time, on one kind of processor; on a GPU as far as its operations can.
    resume : bool
        Whether an interrupted training is resumed from its last whole epoch; the result is that of a training never
        interrupted.
    extend_epochs : int
        Largest number of epochs that a finished training is extended by, at a constant tenth of ``learning_rate``, so
        that an extension by 10 is the beginning of one by 20; patience counts anew.
    threads : int
        Number of threads that torch computes with in training, validation and scoring, whatever the machine has or
        another process leaves: the weights depend on it.
    selection : str
        Which epoch is kept: ``best``, ``smoothed`` or ``last``; see ``models.training.selection.EpochSelection``.
    selection_epochs : int
        Number of epochs of the median of ``smoothed``.
    late_weights : str
        What is validated and kept: ``none`` for the weights after the last step of an epoch, ``ema`` for their
        exponential moving average, ``swa`` for the mean of the last epochs' weights.
    ema_epochs : float
        Number of epochs that the exponential average remembers.
    swa_share : float
        Last share of ``max_epochs`` whose weights are averaged by ``swa``, above 0 to 1; before, nothing is.
    empty_weight : float
        How often a frame without a vessel is drawn in an epoch, from 0; all others are drawn once.
    smoke : bool
        Whether the training shows that all works and not how well; its results are marked so and not compared.
    devices : int
        Number of devices that share each batch, a process each. Gradients are averaged over the parts, weighted by
        their images; the overlap in a loss and the statistics of a batch normalisation are those of a part, so that
        another number of devices is another training.
    strategy : str
        ``ddp`` (``DistributedDataParallel``) for several devices, ``auto`` for that or one device alone.

    Raises
    ------
    InputError
        If a setting is out of range or does not go with another.
    """

    max_epochs: int
    batch_size: int
    learning_rate: float
    patience: int
    schedule: str = "cosine"
    warmup_epochs: int | None = None
    weight_decay: float = 1e-4
    gradient_clip: float = 1.0
    accelerator: str = "cpu"
    precision: str = "32-true"
    deterministic: bool = True
    resume: bool = False
    extend_epochs: int = 0
    threads: int = 1
    selection: str = "best"
    selection_epochs: int = 5
    late_weights: str = "none"
    ema_epochs: float = 2.0
    swa_share: float = 0.25
    empty_weight: float = 1.0
    smoke: bool = False
    devices: int = 1
    strategy: str = "auto"

    def __post_init__(self) -> None:
        for name in ("max_epochs", "batch_size", "patience", "threads", "devices"):
            if getattr(self, name) < 1:
                raise InputError(f"{name}: expected at least 1, received {getattr(self, name)}")
        for name in ("learning_rate", "gradient_clip", "ema_epochs"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise InputError(f"{name}: expected a positive number, received {getattr(self, name)}")
        for name in ("warmup_epochs", "weight_decay", "extend_epochs", "empty_weight"):
            value = getattr(self, name)
            if value is not None and not 0 <= value < math.inf:
                raise InputError(f"{name}: expected a number from 0, received {value}")
        for name, known in (
            ("schedule", schedules.SCHEDULES),
            ("accelerator", ACCELERATORS),
            ("precision", PRECISIONS),
            ("late_weights", LATE_WEIGHTS),
            ("strategy", STRATEGIES),
        ):
            if getattr(self, name) not in known:
                raise InputError(
                    f"{name}: expected one of {', '.join(known)}, received {getattr(self, name)!r}"
                )
        for name in ("deterministic", "resume", "smoke"):
            if not isinstance(getattr(self, name), bool):
                raise InputError(f"{name}: expected true or false, received {getattr(self, name)!r}")
        if not 0 < self.swa_share <= 1:
            raise InputError(f"swa_share: expected above 0 to 1, received {self.swa_share}")
        _ = self.epoch_selection
        if self.devices > self.batch_size:
            raise InputError(
                f"devices: expected at most one for each image of a batch ({self.batch_size}), received {self.devices}"
            )
        if self.accelerator == "cpu" and self.precision == "16-mixed":
            raise InputError(
                "precision: expected 32-true or bf16-mixed on a CPU, where float16 is slower, received "
                f"{self.precision!r}"
            )

    @property
    def epoch_selection(self) -> EpochSelection:
        """Rule that chooses the epoch that is kept."""
        return EpochSelection(self.selection, self.selection_epochs)

    def learning_rate_factor(self, step: int, steps_per_epoch: int) -> float:
        """Compute the factor of ``learning_rate`` at a step of the training.

        Parameters
        ----------
        step : int
            Step, counted from 0.
        steps_per_epoch : int
            Number of batches in an epoch.

        Returns
        -------
        float
            Factor, 0 to 1.
        """
        total = self.max_epochs * steps_per_epoch
        if self.warmup_epochs is not None:
            rise = self.warmup_epochs * steps_per_epoch
        elif self.schedule == "one_cycle":
            rise = round(schedules.ONE_CYCLE_RISE * total)
        else:
            rise = steps_per_epoch
        return schedules.factor(self.schedule, step, rise, total)
