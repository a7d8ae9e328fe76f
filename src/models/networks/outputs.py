"""What a network with more than one output returns while it is trained."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from models.array_types import Float


@dataclass(frozen=True, eq=False)
class SideOutputs:
    """The logits of a network, those of its coarser levels, and whether a vessel is in the image at all.

    ``sides`` are the coarser levels' logits, brought to the images' size, from fine to coarse. ``presence`` is the
    logit of "the image shows a vessel", or None for a network that is not asked. In use, a network returns logits
    alone.
    """

    logits: Float[Tensor, "b 1 h w"]
    sides: tuple[Float[Tensor, "b 1 h w"], ...] = ()
    presence: Float[Tensor, " b"] | None = None
