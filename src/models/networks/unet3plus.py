"""U-Net 3+ (Huang et al., ICASSP 2020) for binary masks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor, nn
from torch.nn import functional

from models.array_types import Float
from models.errors import InputError
from models.networks.blocks import (
    GROUPS,
    Encoder,
    initialise,
    normalisation_layer,
    require_fields,
    require_size_of,
)
from models.networks.outputs import PresenceBranch, SideOutputs, gated, outputs_of
from models.networks.upsampled_convolution import UpsampledConvolution


@dataclass(frozen=True)
class UNet3Plus:
    """Recipe of a U-Net 3+: every level of the decoder sees every level, finer ones from the encoder.

    The encoder is that of ``UNet``. Each branch of a decoder level has ``branch_width`` channels, each
    decoder level ``depth`` times as many. As published are all sizes and layers, convolutions' biases included. Not
    as published: the gate of the class branch is a product of probabilities, where the paper multiplies with the
    class decided on, which teaches nothing to either; the class branch learns from its own loss alone, so that it
    stays a probability; and ``dropout``, which the paper does not have.

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
    deep_supervision : bool
        Whether the coarser levels give logits too, in training, by a 3x3 convolution each.
    classification_guided : bool
        Whether a class branch (dropout, 1x1 convolution, largest value over the coarsest level) predicts that a
        vessel is in the image; all logits then are those of p(pixel | vessel in the image) * p(vessel in the image).

    Raises
    ------
    InputError
        If a setting is out of range.

    Examples
    --------
    >>> sum(p.numel() for p in UNet3Plus(width=64)().parameters())
    26970625
    """

    width: int = 64
    depth: int = 5
    normalisation: str = "batch"
    dropout: float = 0.1
    deep_supervision: bool = False
    classification_guided: bool = False

    name: ClassVar[str] = "unet3plus"

    def __post_init__(self) -> None:
        require_fields(
            width=self.width, depth=self.depth, normalisation=self.normalisation, dropout=self.dropout
        )
        if self.normalisation == "group" and self.width % GROUPS:
            raise InputError(
                f"width: expected a multiple of {GROUPS} for group normalisation, received {self.width}"
            )

    @property
    def branch_width(self) -> int:
        """Number of channels of one full-scale skip: 64 as published."""
        return self.width

    @property
    def multiple(self) -> int:
        """Number that both sides of an image must be multiples of."""
        return int(2 ** (self.depth - 1))

    def __call__(self) -> nn.Module:
        """Build the network with weights drawn from torch's current seed.

        Returns
        -------
        nn.Module
            Images (b, 1, h, w) to logits (b, 1, h, w); in training with an option, to ``SideOutputs``.
        """
        return UNet3PlusModule(self)


class FullScaleBlock(nn.Module):
    """One level of the decoder: a branch from every level, brought to its size, joined and convolved.

    The encoder's features of this level and the finer ones are max-pooled, the decoder's of the coarser ones are
    enlarged bilinearly.

    Parameters
    ----------
    level : int
        This level, counted from 0 at full size.
    channels : sequence of int
        Numbers of channels of the features that come from each level, from fine to coarse.
    branch_width : int
        Number of channels of each branch.
    normalisation : str
        One of ``models.networks.blocks.NORMALISATIONS``.
    """

    def __init__(self, level: int, channels: list[int], branch_width: int, normalisation: str) -> None:
        super().__init__()
        self.level = level
        width = branch_width * len(channels)
        self.branches = nn.ModuleList(
            UpsampledConvolution(count, branch_width, scale=2 ** (source - level))
            if source > level
            else nn.Conv2d(count, branch_width, 3, padding=1)
            for source, count in enumerate(channels)
        )
        # Every branch is normalised and rectified after its convolution: all at once, where they are joined.
        self.joined = nn.Sequential(normalisation_layer(normalisation, width), nn.ReLU(inplace=True))
        self.fusion = nn.Sequential(
            nn.Conv2d(width, width, 3, padding=1),
            normalisation_layer(normalisation, width),
            nn.ReLU(inplace=True),
        )

    def forward(self, features: list[Tensor]) -> Float[Tensor, "b c h w"]:
        """Compute the features of this level.

        Parameters
        ----------
        features : list of Tensor
            Features of every level, from fine to coarse.

        Returns
        -------
        Tensor, shape (b, c, h, w)
            Features at this level's size.
        """
        parts = []
        for source, (branch, feature) in enumerate(zip(self.branches, features, strict=True)):
            if source < self.level:
                feature = torch.max_pool2d(feature, 2 ** (self.level - source))
            parts.append(branch(feature))
        fused: Tensor = self.fusion(self.joined(torch.cat(parts, dim=1)))
        return fused


class UNet3PlusModule(nn.Module):
    """The network that a ``UNet3Plus`` recipe describes."""

    def __init__(self, recipe: UNet3Plus) -> None:
        super().__init__()
        self.multiple = recipe.multiple
        widths = [recipe.width * 2**level for level in range(recipe.depth)]
        decoded = recipe.depth * recipe.branch_width
        self.encoder = Encoder(widths, recipe.normalisation, recipe.dropout, bias=True)
        self.decoder = nn.ModuleList(
            FullScaleBlock(
                level,
                [*widths[: level + 1], *[decoded] * (recipe.depth - level - 2), widths[-1]],
                recipe.branch_width,
                recipe.normalisation,
            )
            for level in reversed(range(recipe.depth - 1))
        )
        self.head = nn.Conv2d(decoded, 1, 3, padding=1)
        self.sides = nn.ModuleList()
        if recipe.deep_supervision:
            coarser = [decoded] * (recipe.depth - 2) + [widths[-1]]
            self.sides.extend(nn.Conv2d(channels, 1, 3, padding=1) for channels in coarser)
        self.presence: PresenceBranch | None = None
        if recipe.classification_guided:
            self.presence = PresenceBranch(widths[-1])
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
            Logits of "vessel" for every pixel; in training with an option, those of the coarser levels as well.
        """
        require_size_of(images, self.multiple)
        features = self.encoder(images)
        presence = None if self.presence is None else self.presence(features[-1])
        # From coarse to fine the decoder's features take the place of the encoder's.
        for block in self.decoder:
            features[block.level] = block(features)
        logits: Tensor = self.head(features[0])
        if not self.training or not self.sides:
            return outputs_of(self, logits, presence)
        sides = tuple(
            self._side(head, feature, images.shape[-2:], presence)
            for head, feature in zip(self.sides, features[1:], strict=False)
        )
        return SideOutputs(logits if presence is None else gated(logits, presence), sides, presence)

    def _side(self, head: nn.Module, feature: Tensor, size: torch.Size, presence: Tensor | None) -> Tensor:
        """A coarser level's logits at the images' size."""
        logits = functional.interpolate(head(feature), size=size, mode="bilinear")
        return logits if presence is None else gated(logits, presence)
