"""What training minimises: functions of logits and masks, computed in 32 bits whatever the network computes in.

Overlaps are taken over the whole batch at once: over single images they would be undefined where no vessel is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, runtime_checkable

import torch
from torch import Tensor
from torch.nn import functional

from models.array_types import Float
from models.errors import InputError
from models.value_types import require_settings

# Below this an overlap counts as perfect: the power of a focal loss has no finite slope at 0.
PERFECT = 1e-7


@runtime_checkable
class Loss(Protocol):
    """Frozen dataclass of settings whose call computes the loss of a batch."""

    def __call__(
        self, logits: Float[Tensor, "b 1 h w"], masks: Float[Tensor, "b 1 h w"]
    ) -> Float[Tensor, ""]:
        """Compute the loss of a batch.

        Parameters
        ----------
        logits : Tensor, shape (b, 1, h, w)
            Logits of "vessel".
        masks : Tensor, shape (b, 1, h, w)
            Reference masks of 0 and 1.

        Returns
        -------
        Tensor, shape ()
            Loss of the batch, in 32 bits.
        """
        ...


@dataclass(frozen=True)
class DiceCrossEntropy:
    """Weighted sum of soft Dice loss (Milletari et al., 3DV 2016) and binary cross-entropy, on logits.

    Parameters
    ----------
    dice_weight, cross_entropy_weight : float
        Weights of the two terms, at least 0.
    smooth : float
        Number of px that keeps Dice defined for a batch without any vessel.

    Raises
    ------
    InputError
        If a setting is out of range.
    """

    dice_weight: float = 1.0
    cross_entropy_weight: float = 1.0
    smooth: float = 1.0

    name: ClassVar[str] = "dice_cross_entropy"

    def __post_init__(self) -> None:
        _require_weights(dice_weight=self.dice_weight, cross_entropy_weight=self.cross_entropy_weight)
        _require_smooth(self.smooth)

    def __call__(
        self, logits: Float[Tensor, "b 1 h w"], masks: Float[Tensor, "b 1 h w"]
    ) -> Float[Tensor, ""]:
        """Compute the loss of a batch.

        Parameters
        ----------
        logits : Tensor, shape (b, 1, h, w)
            Logits of "vessel".
        masks : Tensor, shape (b, 1, h, w)
            Reference masks of 0 and 1.

        Returns
        -------
        Tensor, shape ()
            Loss of the batch, in 32 bits.
        """
        logits, masks = logits.float(), masks.float()
        cross_entropy = functional.binary_cross_entropy_with_logits(logits, masks)
        dice = _missed_overlap(logits, masks, 0.5, 0.5, self.smooth / 2)
        return self.dice_weight * dice + self.cross_entropy_weight * cross_entropy


@dataclass(frozen=True)
class Focal:
    """Focal loss: cross-entropy weighted by (1 - p)^gamma, where p is the probability of the true class.

    It is the mean over pixels.

    Parameters
    ----------
    gamma : float
        Exponent; 0 is cross-entropy, 2 the paper's best.
    alpha : float or None
        Weight of vessel pixels, 0 to 1, with 1 - ``alpha`` for background; 0.25 in the paper. None weights neither.

    Raises
    ------
    InputError
        If a setting is out of range.

    References
    ----------
    T.-Y. Lin et al., ICCV 2017.
    """

    gamma: float = 2.0
    alpha: float | None = 0.25

    name: ClassVar[str] = "focal"

    def __post_init__(self) -> None:
        _require_focal(self.gamma, self.alpha)

    def __call__(
        self, logits: Float[Tensor, "b 1 h w"], masks: Float[Tensor, "b 1 h w"]
    ) -> Float[Tensor, ""]:
        """Compute the loss of a batch.

        Parameters
        ----------
        logits : Tensor, shape (b, 1, h, w)
            Logits of "vessel".
        masks : Tensor, shape (b, 1, h, w)
            Reference masks of 0 and 1.

        Returns
        -------
        Tensor, shape ()
            Loss of the batch, in 32 bits.
        """
        return _focal(logits.float(), masks.float(), self.gamma, self.alpha)


@dataclass(frozen=True)
class DiceFocal:
    """Weighted sum of soft Dice loss and focal loss: ``DiceCrossEntropy`` with ``Focal`` for the cross-entropy.

    Parameters
    ----------
    dice_weight, focal_weight : float
        Weights of the two terms, at least 0.
    gamma : float
        As in ``Focal``.
    alpha : float or None
        As in ``Focal``.
    smooth : float
        As in ``DiceCrossEntropy``.

    Raises
    ------
    InputError
        If a setting is out of range.
    """

    dice_weight: float = 1.0
    focal_weight: float = 1.0
    gamma: float = 2.0
    alpha: float | None = None
    smooth: float = 1.0

    name: ClassVar[str] = "dice_focal"

    def __post_init__(self) -> None:
        _require_weights(dice_weight=self.dice_weight, focal_weight=self.focal_weight)
        _require_focal(self.gamma, self.alpha)
        _require_smooth(self.smooth)

    def __call__(
        self, logits: Float[Tensor, "b 1 h w"], masks: Float[Tensor, "b 1 h w"]
    ) -> Float[Tensor, ""]:
        """Compute the loss of a batch.

        Parameters
        ----------
        logits : Tensor, shape (b, 1, h, w)
            Logits of "vessel".
        masks : Tensor, shape (b, 1, h, w)
            Reference masks of 0 and 1.

        Returns
        -------
        Tensor, shape ()
            Loss of the batch, in 32 bits.
        """
        logits, masks = logits.float(), masks.float()
        focal = _focal(logits, masks, self.gamma, self.alpha)
        dice = _missed_overlap(logits, masks, 0.5, 0.5, self.smooth / 2)
        return self.dice_weight * dice + self.focal_weight * focal


@dataclass(frozen=True)
class Tversky:
    """Tversky loss (Salehi et al., MLMI 2017), for ``gamma`` above 1 focal (Abraham and Khan, ISBI 2019).

    It is (1 - T)^(1 / gamma), where T = TP / (TP + a FP + b FN) is Dice for weights a = b = 0.5. The default weights,
    of both papers, count a missed pixel more than a false one.

    Parameters
    ----------
    false_positive_weight, false_negative_weight : float
        The weights a and b, at least 0.
    gamma : float
        Focal exponent; 4/3 in the second paper, where small errors keep their gradient.
    smooth : float
        Number of px that keeps T defined for a batch without any vessel.

    Raises
    ------
    InputError
        If a setting is out of range.
    """

    false_positive_weight: float = 0.3
    false_negative_weight: float = 0.7
    gamma: float = 1.0
    smooth: float = 1.0

    name: ClassVar[str] = "tversky"

    def __post_init__(self) -> None:
        _require_weights(
            false_positive_weight=self.false_positive_weight, false_negative_weight=self.false_negative_weight
        )
        if not 1 <= self.gamma < math.inf:
            raise InputError(f"gamma: expected a number from 1, received {self.gamma}")
        _require_smooth(self.smooth)

    def __call__(
        self, logits: Float[Tensor, "b 1 h w"], masks: Float[Tensor, "b 1 h w"]
    ) -> Float[Tensor, ""]:
        """Compute the loss of a batch.

        Parameters
        ----------
        logits : Tensor, shape (b, 1, h, w)
            Logits of "vessel".
        masks : Tensor, shape (b, 1, h, w)
            Reference masks of 0 and 1.

        Returns
        -------
        Tensor, shape ()
            Loss of the batch, in 32 bits.
        """
        missed = _missed_overlap(
            logits.float(), masks.float(), self.false_positive_weight, self.false_negative_weight, self.smooth
        )
        return missed if self.gamma == 1 else missed.clamp_min(PERFECT) ** (1 / self.gamma)


LOSSES: dict[str, type[Any]] = {loss.name: loss for loss in (DiceCrossEntropy, DiceFocal, Focal, Tversky)}


def loss_of(name: str, settings: Mapping[str, Any]) -> Loss:
    """Build a loss from its name and settings.

    Parameters
    ----------
    name : str
        One of ``LOSSES``.
    settings : mapping
        Fields of its class.

    Returns
    -------
    Loss
        The loss.

    Raises
    ------
    InputError
        If the name is unknown or the settings are refused.
    """
    if name not in LOSSES:
        raise InputError(f"loss: expected one of {', '.join(sorted(LOSSES))}, received {name!r}")
    try:
        require_settings(LOSSES[name], settings, name)
    except InputError as refusal:
        raise InputError(f"loss: expected settings of {name}, received others ({refusal})") from refusal
    loss: Loss = LOSSES[name](**settings)
    return loss


def _missed_overlap(
    logits: Tensor, masks: Tensor, false_positive_weight: float, false_negative_weight: float, smooth: float
) -> Tensor:
    """1 - (TP + smooth) / (TP + weighted FP + weighted FN + smooth), over all pixels of the batch."""
    probability = torch.sigmoid(logits)
    overlap = (probability * masks).sum()
    mistakes = false_positive_weight * (probability.sum() - overlap) + false_negative_weight * (
        masks.sum() - overlap
    )
    return mistakes / (overlap + mistakes + smooth)


def _focal(logits: Tensor, masks: Tensor, gamma: float, alpha: float | None) -> Tensor:
    # Positive where the pixel is on its right side; powers as exponentials of logarithms, whose slopes stay finite.
    right = torch.where(masks > 0.5, logits, -logits)
    loss = -functional.logsigmoid(right) * torch.exp(gamma * functional.logsigmoid(-right))
    if alpha is not None:
        loss = loss * torch.where(masks > 0.5, alpha, 1 - alpha)
    return loss.mean()


def _require_weights(**weights: float) -> None:
    for name, weight in weights.items():
        if not 0 <= weight < math.inf:
            raise InputError(f"{name}: expected a number from 0, received {weight}")
    if not sum(weights.values()) > 0:
        raise InputError(f"{', '.join(weights)}: expected one above 0, received both 0")


def _require_focal(gamma: float, alpha: float | None) -> None:
    if not 0 <= gamma < math.inf:
        raise InputError(f"gamma: expected a number from 0, received {gamma}")
    if alpha is not None and not 0 < alpha < 1:
        raise InputError(f"alpha: expected a number between 0 and 1 or none, received {alpha}")


def _require_smooth(smooth: float) -> None:
    if not 0 < smooth < math.inf:
        raise InputError(f"smooth: expected a positive number of pixels, received {smooth}")
