"""A U-Net whose encoder is EfficientNet-Lite0, so that it can start from weights trained on natural images."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor, nn
from torch.nn import functional

from models.array_types import Float
from models.errors import InputError
from models.networks.blocks import NORMALISATIONS, UpBlock, initialise, require_size_of
from models.networks.outputs import PresenceBranch, SideOutputs, outputs_of

STEM_CHANNELS = 32
# Kernel, stride, expansion and channels of each inverted bottleneck, as published for EfficientNet-Lite0.
BLOCKS = (
    *((3, 1, 1, 16),),
    *((3, 2, 6, 24), (3, 1, 6, 24)),
    *((5, 2, 6, 40), (5, 1, 6, 40)),
    *((3, 2, 6, 80), (3, 1, 6, 80), (3, 1, 6, 80)),
    *((5, 1, 6, 112), (5, 1, 6, 112), (5, 1, 6, 112)),
    *((5, 2, 6, 192), (5, 1, 6, 192), (5, 1, 6, 192), (5, 1, 6, 192)),
    *((3, 1, 6, 320),),
)
# The blocks whose features the decoder takes: the last ones at a half, a quarter, ... a thirty-second of the size.
TAKEN = (0, 2, 4, 10, 15)
# Channels of the decoder at full size, a half, ... a sixteenth, in multiples of the width.
DECODER = (1, 2, 4, 6, 8)
EPSILON = 1e-3


@dataclass(frozen=True)
class EfficientNetUNet:
    """Recipe of a U-Net with the encoder of EfficientNet-Lite0 and a decoder of double convolutions.

    The encoder's normalisation is by fixed statistics with trainable scale and shift: those of a few frames are too
    rough, and those of the pretrained weights are known. With random weights (``init=shared_random``) its statistics
    are 0 and 1, so that it is not normalised at all.

    Parameters
    ----------
    width : int
        Number of channels of the decoder at full size.
    normalisation : str
        Normalisation layers of the decoder; one of ``models.networks.blocks.NORMALISATIONS``.
    dropout : float
        Fraction of channels dropped of the decoder's two coarsest levels, 0 to below 1.
    presence : bool
        Whether a branch from the coarsest level predicts that a vessel is in the image; as in ``UNet``.

    Raises
    ------
    InputError
        If a setting is out of range.

    References
    ----------
    M. Tan and Q. V. Le, ICML 2019; R. Liu, EfficientNet-Lite, 2020 (no squeeze-and-excitation, ReLU6).
    """

    width: int = 16
    normalisation: str = "instance"
    dropout: float = 0.1
    presence: bool = False

    name: ClassVar[str] = "efficientnet_unet"

    def __post_init__(self) -> None:
        if self.width < 1:
            raise InputError(f"width: expected at least 1 channel, received {self.width}")
        if self.normalisation not in NORMALISATIONS:
            raise InputError(
                f"normalisation: expected one of {', '.join(NORMALISATIONS)}, received {self.normalisation!r}"
            )
        if not 0 <= self.dropout < 1:
            raise InputError(f"dropout: expected 0 to below 1, received {self.dropout}")

    @property
    def multiple(self) -> int:
        """Number that both sides of an image must be multiples of."""
        return 32

    def __call__(self) -> nn.Module:
        """Build the network with weights drawn from torch's current seed.

        Returns
        -------
        nn.Module
            Images (b, 1, h, w) to logits (b, 1, h, w); in training with ``presence``, to ``SideOutputs``.
        """
        return EfficientNetUNetModule(self)


class FixedNormalisation(nn.Module):
    """Batch normalisation by statistics that training does not change; scale and shift are trained.

    Parameters
    ----------
    channels : int
        Number of channels.
    """

    running_mean: Tensor
    running_var: Tensor

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.ones(channels))
        self.bias = nn.Parameter(torch.zeros(channels))
        self.register_buffer("running_mean", torch.zeros(channels))
        self.register_buffer("running_var", torch.ones(channels))

    def forward(self, features: Float[Tensor, "b c h w"]) -> Float[Tensor, "b c h w"]:
        """Normalise features.

        Parameters
        ----------
        features : Tensor, shape (b, c, h, w)
            Features.

        Returns
        -------
        Tensor, shape (b, c, h, w)
            Scaled and shifted features.
        """
        return functional.batch_norm(
            features, self.running_mean, self.running_var, self.weight, self.bias, training=False, eps=EPSILON
        )


class InvertedBottleneck(nn.Module):
    """Expansion, depthwise convolution and projection, with a shortcut where sizes agree.

    Parameters
    ----------
    channels_in : int
        Number of channels of the input.
    kernel, stride, expansion, channels_out : int
        As in ``BLOCKS``.

    References
    ----------
    M. Sandler et al., CVPR 2018.
    """

    def __init__(self, channels_in: int, kernel: int, stride: int, expansion: int, channels_out: int) -> None:
        super().__init__()
        inner = channels_in * expansion
        self.shortcut = stride == 1 and channels_in == channels_out
        self.padding = _padding(kernel, stride)
        self.expand: nn.Module | None = None
        if expansion > 1:
            self.expand = nn.Sequential(
                nn.Conv2d(channels_in, inner, 1, bias=False), FixedNormalisation(inner), nn.ReLU6()
            )
        self.depthwise = nn.Sequential(
            nn.Conv2d(inner, inner, kernel, stride, groups=inner, bias=False),
            FixedNormalisation(inner),
            nn.ReLU6(),
        )
        self.project = nn.Sequential(
            nn.Conv2d(inner, channels_out, 1, bias=False), FixedNormalisation(channels_out)
        )

    def forward(self, features: Float[Tensor, "b c h w"]) -> Float[Tensor, "b d u v"]:
        """Compute the features after this block.

        Parameters
        ----------
        features : Tensor, shape (b, c, h, w)
            Features.

        Returns
        -------
        Tensor, shape (b, d, u, v)
            Features, at half the size where the stride is 2.
        """
        inner = features if self.expand is None else self.expand(features)
        found: Tensor = self.project(self.depthwise(functional.pad(inner, self.padding)))
        return found + features if self.shortcut else found


class EfficientNetLiteEncoder(nn.Module):
    """Stem and inverted bottlenecks of EfficientNet-Lite0 for grey images."""

    def __init__(self) -> None:
        super().__init__()
        self.stem = nn.Sequential(
            nn.Conv2d(1, STEM_CHANNELS, 3, 2, bias=False), FixedNormalisation(STEM_CHANNELS), nn.ReLU6()
        )
        channels = [STEM_CHANNELS, *(block[-1] for block in BLOCKS)]
        self.blocks = nn.ModuleList(
            InvertedBottleneck(before, *block) for before, block in zip(channels, BLOCKS, strict=False)
        )

    def forward(self, images: Float[Tensor, "b 1 h w"]) -> list[Tensor]:
        """Compute the features that the decoder takes.

        Parameters
        ----------
        images : Tensor, shape (b, 1, h, w)
            Normalised images.

        Returns
        -------
        list of Tensor
            The images, then features at a half, a quarter, ... a thirty-second of their size.
        """
        features, taken = self.stem(functional.pad(images, _padding(3, 2))), [images]
        for number, block in enumerate(self.blocks):
            features = block(features)
            if number in TAKEN:
                taken.append(features)
        return taken


class EfficientNetUNetModule(nn.Module):
    """The network that an ``EfficientNetUNet`` recipe describes."""

    def __init__(self, recipe: EfficientNetUNet) -> None:
        super().__init__()
        self.multiple = recipe.multiple
        skips = [1, *(BLOCKS[number][-1] for number in TAKEN)]
        widths = [recipe.width * times for times in DECODER]
        coarser = [*widths[1:], skips[-1]]
        dropouts = [0.0] * (len(DECODER) - 2) + [recipe.dropout] * 2
        self.encoder = EfficientNetLiteEncoder()
        self.decoder = nn.ModuleList(
            UpBlock(coarser[level], skips[level], widths[level], recipe.normalisation, dropouts[level])
            for level in reversed(range(len(DECODER)))
        )
        self.head = nn.Conv2d(recipe.width, 1, 1)
        self.presence = PresenceBranch(skips[-1]) if recipe.presence else None
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


def _padding(kernel: int, stride: int) -> tuple[int, int, int, int]:
    """Padding that the published weights were trained with: of an odd number of pixels, more at the far side."""
    total = kernel - stride
    near, far = total // 2, total - total // 2
    return near, far, near, far
