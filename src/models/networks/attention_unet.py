"""Attention U-Net (Oktay et al., MIDL 2018) for binary masks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor, nn
from torch.nn import functional

from models.array_types import Float
from models.errors import InputError
from models.networks.blocks import (
    Encoder,
    decoder,
    initialise,
    normalisation_layer,
    require_fields,
    require_size_of,
)
from models.networks.outputs import PresenceBranch, SideOutputs, outputs_of


@dataclass(frozen=True)
class AttentionUNet:
    """Recipe of an Attention U-Net: a U-Net whose skips pass additive gates, fed by the next coarser level.

    As published are the gates (see ``AttentionGate``) and what feeds them: the decoder's features of the next coarser
    level, and the bottom's for the coarsest gate. Not as published: two dimensions for three, 64 channels at full
    size for 16, up-convolutions for trilinear resizing, no supervision of the coarser levels, and no further
    convolution around the gates' signals.

    Parameters
    ----------
    width : int
        Number of channels at full size, doubled at each coarser level.
    depth : int
        Number of levels, 2 to 7.
    normalisation : str
        Normalisation layers; one of ``models.networks.blocks.NORMALISATIONS``.
    dropout : float
        Fraction of channels dropped at the two coarsest levels, 0 to below 1.
    gated_levels : sequence of int, or None
        Levels whose skips are gated, counted from 0 at full size. None stands for all but the full-size one, as
        published: three at the published depth of 5.
    presence : bool
        Whether a branch from the coarsest level predicts that a vessel is in the image; as in ``UNet``.

    Raises
    ------
    InputError
        If a setting is out of range.
    """

    width: int = 64
    depth: int = 5
    normalisation: str = "batch"
    dropout: float = 0.1
    gated_levels: Sequence[int] | None = None
    presence: bool = False

    name: ClassVar[str] = "attention_unet"

    def __post_init__(self) -> None:
        require_fields(
            width=self.width, depth=self.depth, normalisation=self.normalisation, dropout=self.dropout
        )
        if self.gated_levels is None:
            if self.depth < 3:
                raise InputError(
                    f"depth: expected at least 3 levels where gated_levels is not given, received {self.depth}"
                )
            return
        # From YAML it is a list.
        levels = tuple(self.gated_levels)
        if len(set(levels)) != len(levels) or not set(levels) <= set(range(self.depth - 1)):
            raise InputError(
                f"gated_levels: expected different levels of 0 to {self.depth - 2}, received {list(levels)}"
            )
        object.__setattr__(self, "gated_levels", levels)

    @property
    def multiple(self) -> int:
        """Number that both sides of an image must be multiples of."""
        return int(2 ** (self.depth - 1))

    def __call__(self) -> nn.Module:
        """Build the network with weights drawn from torch's current seed.

        Returns
        -------
        nn.Module
            Images (b, 1, h, w) to logits (b, 1, h, w); in training with ``presence``, to ``SideOutputs``.
        """
        return AttentionUNetModule(self)


class AttentionGate(nn.Module):
    """Additive grid gate: weighs each pixel of a skip by how it agrees with the next coarser level.

    Both are brought to the coarser grid with as many channels as the skip has, the skip by a 2x2 convolution of
    stride 2 without a bias, the gating signal by a 1x1 one. Sum, rectifier, 1x1 convolution to one channel and
    sigmoid give the attention (0 to 1). It is resized bilinearly to the skip and multiplied with it; a normalised 1x1
    convolution projects the product.

    Parameters
    ----------
    channels_skip : int
        Number of channels of the skip.
    channels_gating : int
        Number of channels of the gating signal.
    normalisation : str
        Normalisation of the projection; one of ``models.networks.blocks.NORMALISATIONS``.
    """

    def __init__(self, channels_skip: int, channels_gating: int, normalisation: str) -> None:
        super().__init__()
        self.skip = nn.Conv2d(channels_skip, channels_skip, 2, stride=2, bias=False)
        self.gating = nn.Conv2d(channels_gating, channels_skip, 1)
        self.psi = nn.Conv2d(channels_skip, 1, 1)
        self.projection = nn.Sequential(
            nn.Conv2d(channels_skip, channels_skip, 1, bias=normalisation == "none"),
            normalisation_layer(normalisation, channels_skip),
        )

    def forward(
        self, skip: Float[Tensor, "b c h w"], gating: Float[Tensor, "b g h//2 w//2"]
    ) -> Float[Tensor, "b c h w"]:
        """Gate the features of a skip.

        Parameters
        ----------
        skip : Tensor, shape (b, c, h, w)
            Encoder features of this level.
        gating : Tensor, shape (b, g, h // 2, w // 2)
            Decoder features of the next coarser level.

        Returns
        -------
        Tensor, shape (b, c, h, w)
            Gated and projected features.
        """
        gated: Tensor = self.projection(skip * self.attention(skip, gating))
        return gated

    def attention(
        self, skip: Float[Tensor, "b c h w"], gating: Float[Tensor, "b g h//2 w//2"]
    ) -> Float[Tensor, "b 1 h w"]:
        """Compute the attention coefficients.

        Parameters
        ----------
        skip : Tensor, shape (b, c, h, w)
            Encoder features of this level.
        gating : Tensor, shape (b, g, h // 2, w // 2)
            Decoder features of the next coarser level.

        Returns
        -------
        Tensor, shape (b, 1, h, w)
            Factor of each pixel, 0 to 1.
        """
        agreement = torch.relu(self.skip(skip) + self.gating(gating))
        coarse = torch.sigmoid(self.psi(agreement))
        return functional.interpolate(coarse, scale_factor=2.0, mode="bilinear", align_corners=False)


class AttentionUNetModule(nn.Module):
    """The network that an ``AttentionUNet`` recipe describes."""

    def __init__(self, recipe: AttentionUNet) -> None:
        super().__init__()
        self.multiple = recipe.multiple
        widths = [recipe.width * 2**level for level in range(recipe.depth)]
        gated = range(1, recipe.depth - 1) if recipe.gated_levels is None else recipe.gated_levels
        self.encoder = Encoder(widths, recipe.normalisation, recipe.dropout)
        self.decoder = decoder(widths, recipe.normalisation)
        self.gates = nn.ModuleDict(
            {
                str(level): AttentionGate(widths[level], widths[level + 1], recipe.normalisation)
                for level in sorted(gated)
            }
        )
        self.head = nn.Conv2d(recipe.width, 1, 1)
        self.presence = PresenceBranch(widths[-1]) if recipe.presence else None
        initialise(self)

    def forward(self, images: Float[Tensor, "b 1 h w"]) -> Float[Tensor, "b 1 h w"] | SideOutputs:
        """Compute logits.

        Parameters
        ----------
        images : Tensor, shape (b, 1, h, w)
            Normalised images.

        Returns
        -------
        Tensor, shape (b, 1, h, w), or SideOutputs
            Logits of "vessel" for every pixel; in training with a presence branch, its logits as well.
        """
        require_size_of(images, self.multiple)
        *skips, features = self.encoder(images)
        presence = None if self.presence is None else self.presence(features)
        for level, up in zip(reversed(range(len(skips))), self.decoder, strict=True):
            skip = skips[level]
            if str(level) in self.gates:
                skip = self.gates[str(level)](skip, features)
            features = up(features, skip)
        return outputs_of(self, self.head(features), presence)
