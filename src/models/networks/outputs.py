"""What a network returns beside its logits: those of coarser levels in training, and whether there is a vessel at all.

A network with a presence branch returns logits that are gated by it, so that every user of its logits has the gate. Who
wants the presence itself calls ``with_presence``: the network then returns ``SideOutputs`` in use as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import torch
from torch import Tensor, nn

from models.array_types import Float

# The share of the coarsest features that a presence branch drops in training, as in the published code of U-Net 3+.
PRESENCE_DROPOUT = 0.5
Network = TypeVar("Network", bound=nn.Module)


@dataclass(frozen=True, eq=False)
class SideOutputs:
    """Outputs of a network in training, and in use after ``with_presence``; otherwise it returns logits alone.

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


class PresenceBranch(nn.Sequential):
    """Dropout and a 1x1 convolution of the coarsest features; the largest value is the logit of a vessel somewhere.

    Parameters
    ----------
    channels : int
        Number of channels of the coarsest features.

    References
    ----------
    Classification-guided module of H. Huang et al., ICASSP 2020.
    """

    def __init__(self, channels: int) -> None:
        super().__init__(nn.Dropout(PRESENCE_DROPOUT), nn.Conv2d(channels, 1, 1))

    def forward(self, features: Float[Tensor, "b c h w"]) -> Float[Tensor, " b"]:
        """Compute the logit of "the image shows a vessel".

        Parameters
        ----------
        features : Tensor, shape (b, c, h, w)
            Coarsest features.

        Returns
        -------
        Tensor, shape (b,)
            Logits.
        """
        logits: Tensor = super().forward(features)
        return logits.amax(dim=(1, 2, 3))


def with_presence(network: Network, returned: bool = True) -> Network:
    """Let a network return its presence logit in use as well.

    Parameters
    ----------
    network : nn.Module
        Any network; one without a presence branch goes on returning logits alone.
    returned : bool, optional
        Whether it is returned; False restores what a network does by itself.

    Returns
    -------
    nn.Module
        The same network. In use it returns ``SideOutputs`` with ``presence``.
    """
    if getattr(network, "presence", None) is not None:
        network.returns_presence = returned  # type: ignore[assignment]
    return network


def outputs_of(
    network: nn.Module, logits: Float[Tensor, "b 1 h w"], presence: Float[Tensor, " b"] | None
) -> Float[Tensor, "b 1 h w"] | SideOutputs:
    """Put together what a network without side outputs returns.

    Parameters
    ----------
    network : nn.Module
        The network, for whether it is in training and what ``with_presence`` set.
    logits : Tensor, shape (b, 1, h, w)
        Logits of the pixels, not gated.
    presence : Tensor, shape (b,), or None
        Logits of its presence branch; None where it has none.

    Returns
    -------
    Tensor, shape (b, 1, h, w), or SideOutputs
        Gated logits; in training or where asked for, with the presence.
    """
    if presence is None:
        return logits
    logits = gated(logits, presence)
    shown = network.training or getattr(network, "returns_presence", False)
    return SideOutputs(logits, (), presence) if shown else logits


def gated(logits: Float[Tensor, "b 1 h w"], presence: Float[Tensor, " b"]) -> Float[Tensor, "b 1 h w"]:
    """Compute the logit of p(pixel) * p(presence), in 32 bits, with no gradient to ``presence``.

    Parameters
    ----------
    logits : Tensor, shape (b, 1, h, w)
        Logits of the pixels.
    presence : Tensor, shape (b,)
        Logits of a vessel in the image.

    Returns
    -------
    Tensor, shape (b, 1, h, w)
        Logits of the product.

    Notes
    -----
    The odds against a product of probabilities are (1 + e^-x)(1 + e^-c) - 1 = e^-x + e^-c + e^-(x + c), whose
    logarithm is stable for logits x and c of any size.
    """
    pixel, image = -logits.float(), -presence.detach().float()[:, None, None, None]
    return -torch.logaddexp(torch.logaddexp(pixel, image), pixel + image)
