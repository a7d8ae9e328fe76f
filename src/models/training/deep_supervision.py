"""The loss of whatever a network returns while it is trained."""

from __future__ import annotations

from torch import Tensor
from torch.nn import functional

from models.array_types import Float
from models.networks.outputs import SideOutputs
from models.training.losses import Loss


def training_loss(
    loss: Loss, outputs: Float[Tensor, "b 1 h w"] | SideOutputs, masks: Float[Tensor, "b 1 h w"]
) -> Float[Tensor, ""]:
    """Compute the loss of a batch on all outputs of a network.

    For ``SideOutputs`` it is the mean over the logits and the sides, each with the same weight, plus the binary
    cross-entropy of ``presence`` against "the mask has a vessel". The mean keeps the scale of a network without
    sides.

    Parameters
    ----------
    loss : Loss
        Loss of logits.
    outputs : Tensor, shape (b, 1, h, w), or SideOutputs
        What the network returned.
    masks : Tensor, shape (b, 1, h, w)
        Reference masks of 0 and 1.

    Returns
    -------
    Tensor, shape ()
        Loss of the batch, in 32 bits.

    References
    ----------
    Equal weights: H. Huang et al., ICASSP 2020.
    """
    if not isinstance(outputs, SideOutputs):
        return loss(outputs, masks)
    levels = (outputs.logits, *outputs.sides)
    total = sum((loss(logits, masks) for logits in levels[1:]), start=loss(levels[0], masks)) / len(levels)
    if outputs.presence is not None:
        present = masks.flatten(1).amax(dim=1)
        total = total + functional.binary_cross_entropy_with_logits(outputs.presence.float(), present.float())
    return total
