"""Networks of MONAI (Cardoso et al., arXiv 2211.02701), built by the configuration like our own."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from torch import Tensor, nn

from models.array_types import Float
from models.errors import InputError
from models.networks.blocks import require_size_of

NETWORKS = ("AttentionUnet", "BasicUNet", "BasicUNetPlusPlus", "DynUNet", "SegResNet", "UNet")
# What this program decides itself: grey images in, one map of logits out.
_FIXED = {"spatial_dims": 2, "in_channels": 1, "out_channels": 1}


@dataclass(frozen=True)
class MonaiNetwork:
    """Recipe of a MONAI network: its class by name, and the settings of that class's constructor.

    All that is not set is MONAI's default: instance normalisation and leaky rectifiers in BasicUNet.

    Parameters
    ----------
    network : str
        Class name; one of ``NETWORKS``.
    width : int
        Number of channels at full size, doubled at each of four coarser levels as in our U-Net (three in SegResNet).
    settings : mapping
        Plain arguments of the constructor, which override what ``width`` implies.

    Raises
    ------
    InputError
        If the network is unknown or the width is out of range.

    Examples
    --------
    >>> MonaiNetwork("BasicUNet", width=16).arguments["features"]
    [16, 32, 64, 128, 256, 16]
    """

    network: str
    width: int = 64
    # A mapping has no hash; equal recipes have equal names and widths, which do.
    settings: Mapping[str, Any] = field(default_factory=dict, hash=False)

    name: ClassVar[str] = "monai"

    def __post_init__(self) -> None:
        if self.network not in NETWORKS:
            raise InputError(f"network: expected one of {', '.join(NETWORKS)}, received {self.network!r}")
        if self.width < 1:
            raise InputError(f"width: expected at least 1 channel, received {self.width}")
        taken = sorted(_FIXED.keys() & self.settings)
        if taken:
            raise InputError(f"settings: expected none of {', '.join(_FIXED)}, received {', '.join(taken)}")
        if self.settings.get("deep_supervision"):
            raise InputError("settings: expected deep_supervision to be false, received true")
        object.__setattr__(self, "settings", _plain(self.settings, "settings"))
        if self.multiple < 1:
            raise InputError(
                f"settings: expected strides of at least 1, received {self.arguments['strides']}"
            )

    @property
    def label(self) -> str:
        """Name in tables: ``name`` is the same for all of MONAI's networks."""
        return f"monai {self.network}"

    @property
    def arguments(self) -> dict[str, Any]:
        """Arguments of the constructor: what ``width`` implies, overridden by the settings."""
        return {**_implied(self.network, self.width), **self.settings, **_FIXED}

    @property
    def multiple(self) -> int:
        """Number that both sides of an image must be multiples of."""
        if self.network in ("BasicUNet", "BasicUNetPlusPlus"):
            return 16
        if self.network == "SegResNet":
            return int(2 ** (len(self.arguments.get("blocks_down", (1, 2, 2, 4))) - 1))
        return _multiple_of(self.arguments["strides"])

    def __call__(self) -> nn.Module:
        """Build the network with weights drawn from torch's current seed.

        Returns
        -------
        nn.Module
            Images (b, 1, h, w) to logits (b, 1, h, w).

        Raises
        ------
        InputError
            If MONAI is not installed, or its class refuses the settings.
        """
        try:
            from monai.networks import nets
        except ModuleNotFoundError as missing:
            raise InputError(
                f"network: expected the package monai for {self.network}, found none (pip install monai)"
            ) from missing
        try:
            inner = getattr(nets, self.network)(**self.arguments)
        except (TypeError, ValueError, AttributeError, KeyError, IndexError) as refusal:
            raise InputError(
                f"settings: expected those of monai's {self.network}, received others ({refusal})"
            ) from refusal
        return MonaiModule(inner, self.multiple)


class MonaiModule(nn.Module):
    """A MONAI network with our way of refusing images and of returning one tensor."""

    def __init__(self, inner: nn.Module, multiple: int) -> None:
        super().__init__()
        self.inner = inner
        self.multiple = multiple

    def forward(self, images: Float[Tensor, "b 1 h w"]) -> Float[Tensor, "b 1 h w"]:
        """Compute logits.

        Parameters
        ----------
        images : Tensor, shape (b, 1, h, w)
            Normalised images.

        Returns
        -------
        Tensor, shape (b, 1, h, w)
            Logits of "vessel" for every pixel.
        """
        require_size_of(images, self.multiple)
        outputs = self.inner(images)
        # BasicUNetPlusPlus gives a list, of one tensor where only its finest level is supervised.
        logits: Tensor = outputs[0] if isinstance(outputs, list) else outputs
        return logits


def _implied(network: str, width: int) -> dict[str, Any]:
    """The arguments that set a network's channels to those of our U-Net of that width, or nearly."""
    channels = [width * 2**level for level in range(5)]
    implied: dict[str, dict[str, Any]] = {
        "AttentionUnet": {"channels": channels, "strides": [2] * 4},
        "BasicUNet": {"features": [*channels, width]},
        "BasicUNetPlusPlus": {"features": [*channels, width]},
        "DynUNet": {
            "filters": channels,
            "kernel_size": [3] * 5,
            "strides": [1, 2, 2, 2, 2],
            "upsample_kernel_size": [2] * 4,
        },
        "SegResNet": {"init_filters": width},
        "UNet": {"channels": channels, "strides": [2] * 4},
    }
    return implied[network]


def _multiple_of(strides: Any) -> int:
    """What both sides must be multiples of for these strides, numbers or pairs, one after the other."""
    pairs = [stride if isinstance(stride, list) else [stride, stride] for stride in strides]
    if not all(len(pair) == 2 and all(isinstance(s, int) and s >= 1 for s in pair) for pair in pairs):
        raise InputError(f"settings: expected strides of at least 1, or pairs of them, received {strides}")
    return math.lcm(*(math.prod(pair[axis] for pair in pairs) for axis in range(2)))


def _plain(value: Any, where: str) -> Any:
    """A copy in which sequences are lists, as YAML and checkpoints hold them; InputError for what neither can."""
    if isinstance(value, Mapping):
        return {str(key): _plain(inner, f"{where}.{key}") for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(inner, f"{where}[{index}]") for index, inner in enumerate(value)]
    if value is None or isinstance(value, (str, int, float)):
        return value
    raise InputError(f"{where}: expected text, numbers, lists or mappings, received {type(value).__name__}")
