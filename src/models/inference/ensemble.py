"""The networks of a model as one module: a batch of images in, the mean probability out."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from models.array_types import Float32
from models.networks.outputs import with_presence


class MeanProbability(nn.Module):
    """Mean of the networks' probabilities, and of their mirror images' where ``flips`` is set.

    A network returns logits (b, 1, h, w), or an object with these as ``logits`` and, as ``presence``, the logits (b,)
    of "the image shows a vessel" or None.

    Parameters
    ----------
    networks : sequence of nn.Module
        Networks, at least one.
    flips : bool
        Whether the mirror image (left to right) counts as much as the image.
    """

    def __init__(self, networks: Sequence[nn.Module], flips: bool = False) -> None:
        super().__init__()
        self.networks = nn.ModuleList(networks)
        for network in networks:
            with_presence(network)
        self.flips = flips

    def forward(self, images: Float32[Tensor, "b 1 h w"]) -> tuple[Tensor, ...]:
        """Compute probabilities.

        Parameters
        ----------
        images : Tensor, shape (b, 1, h, w)
            Normalised images.

        Returns
        -------
        tuple of Tensor
            Probability of vessel (b, 1, h, w); then, if a network has that output, the probability (b,) that the image
            shows a vessel.
        """
        maps: list[Tensor] = []
        presences: list[Tensor] = []
        for network in self.networks:
            for mirrored in (False, True) if self.flips else (False,):
                outputs = network(torch.flip(images, (3,)) if mirrored else images)
                logits, presence = (
                    (outputs, None) if isinstance(outputs, Tensor) else (outputs.logits, outputs.presence)
                )
                probability = torch.sigmoid(logits.float())
                maps.append(torch.flip(probability, (3,)) if mirrored else probability)
                if presence is not None:
                    presences.append(torch.sigmoid(presence.float()))
        mean = _mean(maps)
        return (mean, _mean(presences)) if presences else (mean,)


def _mean(parts: list[Tensor]) -> Tensor:
    """The mean; of one exactly that one."""
    total = parts[0]
    for part in parts[1:]:
        total = total + part
    return total / len(parts) if len(parts) > 1 else total
