"""What a network with more than one output returns while it is trained."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from models.array_types import Float


@dataclass(frozen=True, eq=False)
class SideOutputs:
    """Outputs of a network in training; in use, a network returns logits alone.

    Parameters
    ----------
    logits : Tensor, shape (b, 1, h, w)
        Logits of the network.
    sides : tuple of Tensor, shape (b, 1, h, w)
        Logits of the coarser levels, brought to the images' size, from fine to coarse.
    presence : Tensor, shape (b,), or None
        Logit of "the image shows a vessel"; None for a network without that branch.
    """

    logits: Float[Tensor, "b 1 h w"]
    sides: tuple[Float[Tensor, "b 1 h w"], ...] = ()
    presence: Float[Tensor, " b"] | None = None
