"""The budget of a training: how long, how large, how fast. Free of torch, so that a configuration is read at once."""

from __future__ import annotations

import math
from dataclasses import dataclass

from models.errors import InputError

ACCELERATORS = ("cpu", "gpu", "auto")
PRECISIONS = ("32-true", "16-mixed", "bf16-mixed")


@dataclass(frozen=True)
class TrainerSettings:
    """How a network is trained.

    AdamW (Loshchilov and Hutter, ICLR 2019) from ``learning_rate`` after ``warmup_epochs`` of linear rise, down to
    zero along a cosine; gradients clipped to norm ``gradient_clip``; stopped once the validation DSC has not risen
    for ``patience`` epochs. ``accelerator`` is one of ``ACCELERATORS``, ``precision`` of ``PRECISIONS``.
    """

    max_epochs: int
    batch_size: int
    image_size_px: int
    learning_rate: float
    patience: int
    warmup_epochs: int = 1
    weight_decay: float = 1e-4
    gradient_clip: float = 1.0
    accelerator: str = "cpu"
    precision: str = "32-true"

    def __post_init__(self) -> None:
        for name in ("max_epochs", "batch_size", "image_size_px", "patience"):
            if getattr(self, name) < 1:
                raise InputError(f"{name}: expected at least 1, received {getattr(self, name)}")
        for name in ("learning_rate", "gradient_clip"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise InputError(f"{name}: expected a positive number, received {getattr(self, name)}")
        for name in ("warmup_epochs", "weight_decay"):
            if not getattr(self, name) >= 0:
                raise InputError(f"{name}: expected a number from 0, received {getattr(self, name)}")
        if self.accelerator not in ACCELERATORS:
            raise InputError(
                f"accelerator: expected one of {', '.join(ACCELERATORS)}, received {self.accelerator!r}"
            )
        if self.precision not in PRECISIONS:
            raise InputError(
                f"precision: expected one of {', '.join(PRECISIONS)}, received {self.precision!r}"
            )

    def learning_rate_factor(self, step: int, steps_per_epoch: int) -> float:
        """What the learning rate is multiplied by at a step: a linear rise, then half a cosine down to zero."""
        warmup, total = self.warmup_epochs * steps_per_epoch, self.max_epochs * steps_per_epoch
        if step < warmup:
            return (step + 1) / (warmup + 1)
        return 0.5 * (1 + math.cos(math.pi * min(1.0, (step - warmup) / max(1, total - warmup))))
