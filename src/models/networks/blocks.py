"""The pieces that networks of the U-Net family are built from."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from models.array_types import Float
from models.errors import InputError

NORMALISATIONS = ("batch", "instance", "group", "none")
GROUPS = 8


def normalisation_layer(kind: str, channels: int) -> nn.Module:
    """Build a normalisation layer.

    Parameters
    ----------
    kind : str
        One of ``NORMALISATIONS``.
    channels : int
        Number of channels.

    Returns
    -------
    nn.Module
        The layer; the identity for ``none``.

    Raises
    ------
    InputError
        If the kind is unknown.
    """
    if kind == "batch":
        return nn.BatchNorm2d(channels)
    if kind == "instance":
        return nn.InstanceNorm2d(channels, affine=True)
    if kind == "group":
        return nn.GroupNorm(min(GROUPS, channels), channels)
    if kind == "none":
        return nn.Identity()
    raise InputError(f"normalisation: expected one of {', '.join(NORMALISATIONS)}, received {kind!r}")


class DoubleConvolution(nn.Sequential):
    """Two 3x3 convolutions, padded to keep the size, each normalised and rectified; then channel dropout.

    Parameters
    ----------
    channels_in, channels_out : int
        Numbers of channels.
    normalisation : str
        One of ``NORMALISATIONS``.
    dropout : float
        Fraction of channels dropped, 0 to below 1.
    bias : bool
        Whether convolutions have biases also where they are normalised.
    """

    def __init__(
        self, channels_in: int, channels_out: int, normalisation: str, dropout: float, bias: bool = False
    ) -> None:
        # A normalisation subtracts the mean, and any bias with it.
        bias = bias or normalisation == "none"
        super().__init__(
            nn.Conv2d(channels_in, channels_out, 3, padding=1, bias=bias),
            normalisation_layer(normalisation, channels_out),
            nn.ReLU(inplace=True),
            nn.Conv2d(channels_out, channels_out, 3, padding=1, bias=bias),
            normalisation_layer(normalisation, channels_out),
            nn.ReLU(inplace=True),
        )
        if dropout:
            self.append(nn.Dropout2d(dropout))


class Encoder(nn.ModuleList):
    """Double convolutions, one level after the other, with 2x2 max pooling between; each level is half as large.

    Parameters
    ----------
    widths : sequence of int
        Numbers of channels of the levels, from fine to coarse.
    normalisation : str
        One of ``NORMALISATIONS``.
    dropout : float
        Fraction of channels dropped at the two coarsest levels.
    bias : bool
        Whether convolutions have biases also where they are normalised.
    """

    def __init__(self, widths: Sequence[int], normalisation: str, dropout: float, bias: bool = False) -> None:
        dropouts = [0.0] * (len(widths) - 2) + [dropout] * 2
        super().__init__(
            DoubleConvolution(before, after, normalisation, level_dropout, bias)
            for before, after, level_dropout in zip([1, *widths], widths, dropouts, strict=False)
        )

    def forward(self, images: Float[Tensor, "b 1 h w"]) -> list[Tensor]:
        """Compute the features of every level.

        Parameters
        ----------
        images : Tensor, shape (b, 1, h, w)
            Normalised images.

        Returns
        -------
        list of Tensor
            Features from fine to coarse.
        """
        features: list[Tensor] = []
        for convolutions in self:
            features.append(convolutions(torch.max_pool2d(features[-1], 2) if features else images))
        return features


class UpBlock(nn.Module):
    """Decoder block: a 2x2 up-convolution, concatenation with the encoder's features, a double convolution.

    Parameters
    ----------
    channels_in : int
        Number of channels of the coarser level.
    channels_skip : int
        Number of channels of the encoder's features.
    channels_out : int
        Number of channels of the result.
    normalisation : str
        One of ``NORMALISATIONS``.
    dropout : float
        Fraction of channels dropped, 0 to below 1.
    """

    def __init__(
        self, channels_in: int, channels_skip: int, channels_out: int, normalisation: str, dropout: float
    ) -> None:
        super().__init__()
        self.up = nn.ConvTranspose2d(channels_in, channels_out, 2, stride=2)
        self.convolutions = DoubleConvolution(
            channels_out + channels_skip, channels_out, normalisation, dropout
        )

    def forward(
        self, coarse: Float[Tensor, "b c h w"], skip: Float[Tensor, "b s 2*h 2*w"]
    ) -> Float[Tensor, "b o 2*h 2*w"]:
        """Compute the features of one level of the decoder.

        Parameters
        ----------
        coarse : Tensor, shape (b, c, h, w)
            Features of the coarser level.
        skip : Tensor, shape (b, s, 2 * h, 2 * w)
            Encoder features of this level.

        Returns
        -------
        Tensor, shape (b, o, 2 * h, 2 * w)
            Features of this level.
        """
        joined: Tensor = self.convolutions(torch.cat([skip, self.up(coarse)], dim=1))
        return joined


def decoder(widths: Sequence[int], normalisation: str) -> nn.ModuleList:
    """Build the up-blocks of a decoder.

    Parameters
    ----------
    widths : sequence of int
        Numbers of channels of the encoder's levels, from fine to coarse.
    normalisation : str
        One of ``NORMALISATIONS``.

    Returns
    -------
    nn.ModuleList
        Up-blocks from coarse to fine.
    """
    return nn.ModuleList(
        UpBlock(coarse, fine, fine, normalisation, 0.0)
        for fine, coarse in zip(reversed(widths[:-1]), reversed(widths[1:]), strict=True)
    )


def initialise(network: nn.Module) -> None:
    """Draw the weights of all convolutions for rectified units from torch's current seed.

    Parameters
    ----------
    network : nn.Module
        Changed in place.

    References
    ----------
    K. He et al., ICCV 2015.
    """
    for module in network.modules():
        if isinstance(module, (nn.Conv2d, nn.ConvTranspose2d)):
            nn.init.kaiming_normal_(module.weight, nonlinearity="relu")
            if module.bias is not None:
                nn.init.zeros_(module.bias)


def require_size(height: int, width: int, multiple: int) -> None:
    """Check an image size.

    Parameters
    ----------
    height, width : int
        Size in px.
    multiple : int
        Number that both sides must be multiples of, and at least twice.

    Raises
    ------
    InputError
        If a side is not such a multiple.
    """
    # At once the multiple, the coarsest level is a single pixel, and batch statistics over it are undefined.
    if height % multiple or width % multiple or min(height, width) < 2 * multiple:
        raise InputError(
            f"image size: expected sides that are multiples of {multiple}, {2 * multiple} at least, "
            f"received {height} x {width}"
        )


def require_size_of(images: Tensor, multiple: int) -> None:
    """Check the size of images.

    Parameters
    ----------
    images : Tensor
        Images, (b, c, h, w).
    multiple : int
        Number that both sides must be multiples of, and at least twice.

    Raises
    ------
    InputError
        If a side is not such a multiple.
    """
    # While a network is traced for export, sizes are tensors.
    require_size(int(images.shape[-2]), int(images.shape[-1]), multiple)


def require_fields(*, width: int, depth: int, normalisation: str, dropout: float) -> None:
    """Check the settings that networks of the U-Net family share.

    Parameters
    ----------
    width : int
        Number of channels at full size.
    depth : int
        Number of levels.
    normalisation : str
        Kind of normalisation layer.
    dropout : float
        Fraction of channels dropped.

    Raises
    ------
    InputError
        If a setting is out of range.
    """
    if width < 1:
        raise InputError(f"width: expected at least 1 channel, received {width}")
    if not 2 <= depth <= 7:
        raise InputError(f"depth: expected 2 to 7 levels, received {depth}")
    if normalisation not in NORMALISATIONS:
        raise InputError(
            f"normalisation: expected one of {', '.join(NORMALISATIONS)}, received {normalisation!r}"
        )
    if normalisation == "group" and width > GROUPS and width % GROUPS:
        raise InputError(f"width: expected a multiple of {GROUPS} for group normalisation, received {width}")
    if not 0 <= dropout < 1:
        raise InputError(f"dropout: expected 0 to below 1, received {dropout}")
