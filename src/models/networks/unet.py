"""U-Net (Ronneberger, Fischer and Brox, MICCAI 2015) for binary masks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from torch import Tensor, nn

from models.array_types import Float
from models.networks.blocks import Encoder, decoder, initialise, require_fields, require_size_of
from models.networks.outputs import PresenceBranch, SideOutputs, outputs_of


@dataclass(frozen=True)
class UNet:
    """Recipe of a U-Net: calling it builds the network with weights drawn from torch's current seed.

    Other than in the paper, convolutions are padded, so that the mask has the image's size, and normalised.

    Parameters
    ----------
    width : int
        Number of channels at full size (64 as published), doubled at each coarser level.
    depth : int
        Number of levels, 2 to 7.
    normalisation : str
        Normalisation layers; one of ``models.networks.blocks.NORMALISATIONS``.
    dropout : float
        Fraction of channels dropped at the two coarsest levels, where the paper has it; 0 to below 1.
    presence : bool
        Whether a branch from the coarsest level predicts that a vessel is in the image, which the paper does not
        have; logits then are those of p(pixel | vessel in the image) * p(vessel in the image).

    Raises
    ------
    InputError
        If a setting is out of range.

    Examples
    --------
    >>> sum(p.numel() for p in UNet(width=64, normalisation="none")().parameters())
    31030593
    """

    width: int = 64
    depth: int = 5
    normalisation: str = "batch"
    dropout: float = 0.1
    presence: bool = False

    name: ClassVar[str] = "unet"

    def __post_init__(self) -> None:
        require_fields(
            width=self.width, depth=self.depth, normalisation=self.normalisation, dropout=self.dropout
        )

    @property
    def multiple(self) -> int:
        """Number that both sides of an image must be multiples of."""
        return int(2 ** (self.depth - 1))

    def __call__(self) -> nn.Module:
        """Build the network.

        Returns
        -------
        nn.Module
            Images (b, 1, h, w) to logits (b, 1, h, w); in training with ``presence``, to ``SideOutputs``.
        """
        return UNetModule(self)


class UNetModule(nn.Module):
    """The network that a ``UNet`` recipe describes."""

    def __init__(self, recipe: UNet) -> None:
        super().__init__()
        self.multiple = recipe.multiple
        widths = [recipe.width * 2**level for level in range(recipe.depth)]
        self.encoder = Encoder(widths, recipe.normalisation, recipe.dropout)
        self.decoder = decoder(widths, recipe.normalisation)
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
        for up in self.decoder:
            features = up(features, skips.pop())
        return outputs_of(self, self.head(features), presence)
