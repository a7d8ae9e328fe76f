"""Distillation: training of one network on the probabilities of an ensemble."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor
from torch.nn import functional

from models.array_types import Float
from models.errors import InputError
from models.training.losses import Loss

# Smallest distance of the ensemble's probabilities from 0 and 1, so that their logits are finite.
MIN_PROBABILITY = 2.0**-20


@dataclass(frozen=True)
class Distillation:
    """Loss of a student's logits against an ensemble's probabilities; 0 only where they are the same.

    It is a ``models.training.losses.Loss`` with the ensemble's probabilities in the place of masks.

    Parameters
    ----------
    divergence_weight, overlap_weight : float, optional
        Weights of the two terms; from 0, one above 0.
    temperature : float, optional
        Divisor of both sides' logits in the divergence; from 1.
    smooth : float, optional
        Smoothing of the overlap in pixels; keeps it defined for a batch without any vessel.

    Raises
    ------
    InputError
        If a parameter is out of range.

    Notes
    -----
    Weighted sum of the Kullback-Leibler divergence of a pixel's softened probabilities, times ``temperature``
    squared so that gradients keep their size, and of an overlap term over the batch: the first Dice
    semimetric loss, which, unlike soft Dice, is lowest where student and ensemble agree.

    References
    ----------
    G. Hinton, O. Vinyals and J. Dean, 2015, section 2; Wang et al., MICCAI 2023 (Dice semimetric losses).
    """

    divergence_weight: float = 1.0
    overlap_weight: float = 1.0
    temperature: float = 1.0
    smooth: float = 1.0

    name: ClassVar[str] = "distillation"

    def __post_init__(self) -> None:
        weights = (self.divergence_weight, self.overlap_weight)
        if not all(0 <= weight < math.inf for weight in weights) or not sum(weights) > 0:
            raise InputError(
                f"divergence_weight, overlap_weight: expected numbers from 0, one above 0, received {weights}"
            )
        if not 1 <= self.temperature < math.inf:
            raise InputError(f"temperature: expected a number from 1, received {self.temperature}")
        if not 0 < self.smooth < math.inf:
            raise InputError(f"smooth: expected a positive number of pixels, received {self.smooth}")

    def __call__(
        self, logits: Float[Tensor, "b 1 h w"], masks: Float[Tensor, "b 1 h w"]
    ) -> Float[Tensor, ""]:
        """Compute the loss of a batch.

        Parameters
        ----------
        logits : Tensor, shape (b, 1, h, w)
            Logits of the student.
        masks : Tensor, shape (b, 1, h, w)
            Probabilities of the ensemble, 0 to 1.

        Returns
        -------
        Tensor, shape ()
            The loss.
        """
        logits, ensemble = logits.float(), masks.float()
        loss = logits.new_zeros(())
        if self.divergence_weight:
            loss = loss + self.divergence_weight * self.temperature**2 * self._divergence(logits, ensemble)
        if self.overlap_weight:
            loss = loss + self.overlap_weight * self._overlap(torch.sigmoid(logits), ensemble)
        return loss

    def _divergence(self, logits: Tensor, ensemble: Tensor) -> Tensor:
        teacher = torch.logit(ensemble, eps=MIN_PROBABILITY) / self.temperature
        student, soft = logits / self.temperature, torch.sigmoid(teacher)
        # Cross-entropy less the ensemble's own entropy, both from logits: exactly 0 for equal ones.
        cross = functional.binary_cross_entropy_with_logits(student, soft)
        return cross - functional.binary_cross_entropy_with_logits(teacher, soft)

    def _overlap(self, student: Tensor, ensemble: Tensor) -> Tensor:
        apart = (student - ensemble).abs().sum()
        return apart / (student.sum() + ensemble.sum() + self.smooth)


@dataclass(frozen=True)
class DistillationWithReference:
    """Weighted mean of distillation and of a loss against the reference masks.

    Parameters
    ----------
    distillation : Distillation
        Loss against the ensemble.
    reference : Loss
        Loss against the masks.
    ensemble_share : float, optional
        Weight of the distillation, 0 to 1.

    Raises
    ------
    InputError
        If the share is out of range.
    """

    distillation: Distillation
    reference: Loss
    ensemble_share: float = 0.5

    name: ClassVar[str] = "distillation_with_reference"

    def __post_init__(self) -> None:
        if not 0 <= self.ensemble_share <= 1:
            raise InputError(f"ensemble_share: expected 0 to 1, received {self.ensemble_share}")

    def __call__(
        self,
        logits: Float[Tensor, "b 1 h w"],
        masks: Float[Tensor, "b 1 h w"],
        ensemble: Float[Tensor, "b 1 h w"],
    ) -> Float[Tensor, ""]:
        """Compute the loss of a batch.

        Parameters
        ----------
        logits : Tensor, shape (b, 1, h, w)
            Logits of the student.
        masks : Tensor, shape (b, 1, h, w)
            Reference masks, 0 and 1.
        ensemble : Tensor, shape (b, 1, h, w)
            Probabilities of the ensemble, 0 to 1.

        Returns
        -------
        Tensor, shape ()
            The loss.
        """
        soft = self.distillation(logits, ensemble)
        hard = self.reference(logits, masks)
        return self.ensemble_share * soft + (1 - self.ensemble_share) * hard
