"""The pieces that networks of the U-Net family are built from."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from models.errors import InputError
from models.shapes import Float

NORMALISATIONS = ("batch", "instance", "group", "none")
GROUPS = 8


def normalisation_layer(kind: str, channels: int) -> nn.Module:
    """The layer that ``kind`` names (one of ``NORMALISATIONS``) for ``channels`` channels."""
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
    """Two 3x3 convolutions, padded to keep the size, each normalised and rectified; then channel dropout."""

    def __init__(self, channels_in: int, channels_out: int, normalisation: str, dropout: float) -> None:
        # A normalisation subtracts the mean, and any bias with it.
        bias = normalisation == "none"
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


class UpBlock(nn.Module):
    """Doubles the size by a 2x2 up-convolution, joins the encoder's features of that size, convolves twice."""

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
        """From features of the coarser level and of the encoder at this one."""
        joined: Tensor = self.convolutions(torch.cat([skip, self.up(coarse)], dim=1))
        return joined


def initialise(network: nn.Module) -> None:
    """Draw all convolutions' weights for rectified units (He et al., ICCV 2015) from torch's current seed."""
    for module in network.modules():
        if isinstance(module, (nn.Conv2d, nn.ConvTranspose2d)):
            nn.init.kaiming_normal_(module.weight, nonlinearity="relu")
            if module.bias is not None:
                nn.init.zeros_(module.bias)


def require_size(height: int, width: int, multiple: int) -> None:
    """Raise InputError unless both sides are multiples of ``multiple``, twice it at least."""
    # At once the multiple, the coarsest level is a single pixel, and batch statistics over it are undefined.
    if height % multiple or width % multiple or min(height, width) < 2 * multiple:
        raise InputError(
            f"image size: expected sides that are multiples of {multiple}, {2 * multiple} at least, "
            f"received {height} x {width}"
        )
