"""U-Net (Ronneberger, Fischer and Brox, MICCAI 2015) for binary masks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor, nn

from models.blocks import NORMALISATIONS, DoubleConvolution, UpBlock, initialise, require_size
from models.errors import InputError
from models.shapes import Float


@dataclass(frozen=True)
class UNet:
    """The recipe of a U-Net: ``recipe()`` builds the network with weights drawn from torch's current seed.

    ``width`` is the number of channels at full size (64 as published), doubled at each of the other ``depth - 1``
    levels. ``dropout`` (0 to below 1) is the share of channels dropped at the two coarsest levels, where the paper
    has it. Against the paper, convolutions are padded, so that the mask has the image's size, and normalised.

    >>> sum(p.numel() for p in UNet(width=64, normalisation="none")().parameters())
    31030593
    """

    width: int = 64
    depth: int = 5
    normalisation: str = "batch"
    dropout: float = 0.1

    name: ClassVar[str] = "unet"

    def __post_init__(self) -> None:
        if self.width < 1:
            raise InputError(f"width: expected at least 1 channel, received {self.width}")
        if not 2 <= self.depth <= 7:
            raise InputError(f"depth: expected 2 to 7 levels, received {self.depth}")
        if self.normalisation not in NORMALISATIONS:
            raise InputError(
                f"normalisation: expected one of {', '.join(NORMALISATIONS)}, received {self.normalisation!r}"
            )
        if self.normalisation == "group" and self.width > 8 and self.width % 8:
            raise InputError(
                f"width: expected a multiple of 8 for group normalisation, received {self.width}"
            )
        if not 0 <= self.dropout < 1:
            raise InputError(f"dropout: expected 0 to below 1, received {self.dropout}")

    @property
    def multiple(self) -> int:
        """What both sides of an image must be multiples of."""
        return int(2 ** (self.depth - 1))

    def __call__(self) -> nn.Module:
        """Build the network: images (b, 1, h, w) to logits (b, 1, h, w)."""
        return UNetModule(self)


class UNetModule(nn.Module):
    """The network that a ``UNet`` recipe describes."""

    def __init__(self, recipe: UNet) -> None:
        super().__init__()
        self.multiple = recipe.multiple
        widths = [recipe.width * 2**level for level in range(recipe.depth)]
        dropouts = [0.0] * (recipe.depth - 2) + [recipe.dropout] * 2
        self.encoder = nn.ModuleList(
            DoubleConvolution(before, after, recipe.normalisation, dropout)
            for before, after, dropout in zip([1, *widths], widths, dropouts, strict=False)
        )
        self.decoder = nn.ModuleList(
            UpBlock(coarse, fine, fine, recipe.normalisation, 0.0)
            for fine, coarse in zip(reversed(widths[:-1]), reversed(widths[1:]), strict=True)
        )
        self.head = nn.Conv2d(recipe.width, 1, 1)
        initialise(self)

    def forward(self, images: Float[Tensor, "b 1 h w"]) -> Float[Tensor, "b 1 h w"]:
        """Logits of "vessel" for every pixel."""
        require_size(images.shape[-2], images.shape[-1], self.multiple)
        features, skips = images, []
        for level, convolutions in enumerate(self.encoder):
            if level:
                skips.append(features)
                features = torch.max_pool2d(features, 2)
            features = convolutions(features)
        for up in self.decoder:
            features = up(features, skips.pop())
        logits: Tensor = self.head(features)
        return logits
