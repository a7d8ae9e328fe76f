"""What training minimises."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from models.errors import InputError
from models.shapes import Float


@dataclass(frozen=True)
class DiceCrossEntropy:
    """Weighted sum of soft Dice loss (Milletari et al., 3DV 2016) and binary cross-entropy, on logits.

    Dice is taken over the whole batch at once: over single images it would be undefined where no vessel is. ``smooth``
    (in pixels) keeps it defined for a batch without any.
    """

    dice_weight: float = 1.0
    cross_entropy_weight: float = 1.0
    smooth: float = 1.0

    def __post_init__(self) -> None:
        for name in ("dice_weight", "cross_entropy_weight"):
            if not getattr(self, name) >= 0:
                raise InputError(f"{name}: expected a number from 0, received {getattr(self, name)}")
        if not self.dice_weight + self.cross_entropy_weight > 0:
            raise InputError("dice_weight, cross_entropy_weight: expected one above 0, received both 0")
        if not self.smooth > 0:
            raise InputError(f"smooth: expected a positive number of pixels, received {self.smooth}")

    def __call__(
        self, logits: Float[Tensor, "b 1 h w"], masks: Float[Tensor, "b 1 h w"]
    ) -> Float[Tensor, ""]:
        """The loss of a batch; ``masks`` are 0 and 1."""
        probability = torch.sigmoid(logits)
        overlap = (probability * masks).sum()
        total = probability.sum() + masks.sum()
        dice = 1 - (2 * overlap + self.smooth) / (total + self.smooth)
        cross_entropy = functional.binary_cross_entropy_with_logits(logits, masks)
        return self.dice_weight * dice + self.cross_entropy_weight * cross_entropy
