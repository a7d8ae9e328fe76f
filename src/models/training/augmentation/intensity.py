"""Transforms of grey values: speckle and depth gain of the echo; gamma, contrast and brightness of the display."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import torch
from torch import Tensor
from torch.nn import functional

from models.array_types import Float32
from models.training.augmentation.protocols import (
    RandomDraws,
    random_factor,
    require_amounts,
    require_probability,
)


@dataclass(frozen=True)
class Speckle:
    """Multiplicative noise with grains, like speckle: it spares black and grows with the grey value.

    Parameters
    ----------
    probability : float
        Probability for each image, 0 to 1.
    std : float
        Standard deviation of the noise by which 1 is changed.
    grain_px : int
        Size of a grain in px.

    Raises
    ------
    InputError
        If a value is out of range.
    """

    stage: ClassVar[Literal["echo"]] = "echo"
    probability: float = 0.1
    std: float = 0.125
    grain_px: int = 2

    def __post_init__(self) -> None:
        require_probability(self)
        require_amounts(self, "std")
        require_amounts(self, "grain_px", minimum=1)

    def __call__(self, images: Float32[Tensor, "b 1 h w"], draws: RandomDraws) -> Float32[Tensor, "b 1 h w"]:
        """Multiply images by 1 plus noise.

        Parameters
        ----------
        images : Tensor, shape (b, 1, h, w)
            Grey values of 0 to 1.
        draws : RandomDraws
            Source of the random numbers.

        Returns
        -------
        Tensor, shape (b, 1, h, w)
            New images, not clipped.
        """
        height, width = images.shape[-2:]
        noise = draws.normal(1, -(-height // self.grain_px), -(-width // self.grain_px))
        noise = functional.interpolate(noise, size=(height, width), mode="bilinear", align_corners=False)
        amount = self.std / _interpolated_std(self.grain_px)
        return (amount * draws.chosen(self.probability, 1, 1, 1) * noise).add_(1).mul_(images)


@dataclass(frozen=True)
class DepthGain:
    """Random time gain: from the top of the image to the bottom it runs evenly in decibels, with 1 in the middle.

    Parameters
    ----------
    probability : float
        Probability for each image, 0 to 1.
    max_change : float
        The gain at top and bottom lies between 1 / (1 + max_change) and 1 + max_change.

    Raises
    ------
    InputError
        If a value is out of range.
    """

    stage: ClassVar[Literal["echo"]] = "echo"
    probability: float = 0.2
    max_change: float = 0.5

    def __post_init__(self) -> None:
        require_probability(self)
        require_amounts(self, "max_change")

    def __call__(self, images: Float32[Tensor, "b 1 h w"], draws: RandomDraws) -> Float32[Tensor, "b 1 h w"]:
        """Multiply images by a gain that depends on the depth.

        Parameters
        ----------
        images : Tensor, shape (b, 1, h, w)
            Grey values of 0 to 1.
        draws : RandomDraws
            Source of the random numbers.

        Returns
        -------
        Tensor, shape (b, 1, h, w)
            New images, not clipped.
        """
        slope = draws.chosen(self.probability, 1, 1, 1) * draws.signed(1, 1, 1)
        depth = torch.linspace(-1, 1, images.shape[-2], device=images.device)[:, None]
        return images * random_factor(self.max_change, slope * depth)


@dataclass(frozen=True)
class Gamma:
    """Random power of the grey values: black and white stay.

    Parameters
    ----------
    probability : float
        Probability for each image, 0 to 1.
    max_change : float
        The exponent lies between 1 / (1 + max_change) and 1 + max_change.

    Raises
    ------
    InputError
        If a value is out of range.
    """

    stage: ClassVar[Literal["display"]] = "display"
    probability: float = 0.3
    max_change: float = 0.4

    def __post_init__(self) -> None:
        require_probability(self)
        require_amounts(self, "max_change")

    def __call__(self, images: Float32[Tensor, "b 1 h w"], draws: RandomDraws) -> Float32[Tensor, "b 1 h w"]:
        """Raise images to a random power.

        Parameters
        ----------
        images : Tensor, shape (b, 1, h, w)
            Grey values of 0 to 1; values below 0 count as 0.
        draws : RandomDraws
            Source of the random numbers.

        Returns
        -------
        Tensor, shape (b, 1, h, w)
            New images, not clipped.
        """
        chosen = draws.chosen(self.probability, 1, 1, 1)
        return images.clamp_min(0).pow_(random_factor(self.max_change, chosen * draws.signed(1, 1, 1)))


@dataclass(frozen=True)
class Contrast:
    """Random stretching of the grey values about the image's mean.

    Parameters
    ----------
    probability : float
        Probability for each image, 0 to 1.
    max_change : float
        The factor lies between 1 / (1 + max_change) and 1 + max_change.

    Raises
    ------
    InputError
        If a value is out of range.
    """

    stage: ClassVar[Literal["display"]] = "display"
    probability: float = 0.3
    max_change: float = 0.3

    def __post_init__(self) -> None:
        require_probability(self)
        require_amounts(self, "max_change")

    def __call__(self, images: Float32[Tensor, "b 1 h w"], draws: RandomDraws) -> Float32[Tensor, "b 1 h w"]:
        """Stretch images about their means.

        Parameters
        ----------
        images : Tensor, shape (b, 1, h, w)
            Grey values of 0 to 1.
        draws : RandomDraws
            Source of the random numbers.

        Returns
        -------
        Tensor, shape (b, 1, h, w)
            New images, not clipped.
        """
        chosen = draws.chosen(self.probability, 1, 1, 1)
        factor = random_factor(self.max_change, chosen * draws.signed(1, 1, 1))
        mean = images.mean(dim=(1, 2, 3), keepdim=True)
        return (images * factor).add_(mean * (1 - factor))


@dataclass(frozen=True)
class Brightness:
    """Random constant added to all grey values of an image.

    Parameters
    ----------
    probability : float
        Probability for each image, 0 to 1.
    max_change : float
        Largest constant in either direction, where grey values run from 0 to 1.

    Raises
    ------
    InputError
        If a value is out of range.
    """

    stage: ClassVar[Literal["display"]] = "display"
    probability: float = 0.3
    max_change: float = 0.1

    def __post_init__(self) -> None:
        require_probability(self)
        require_amounts(self, "max_change")

    def __call__(self, images: Float32[Tensor, "b 1 h w"], draws: RandomDraws) -> Float32[Tensor, "b 1 h w"]:
        """Add a constant to each image.

        Parameters
        ----------
        images : Tensor, shape (b, 1, h, w)
            Grey values of 0 to 1.
        draws : RandomDraws
            Source of the random numbers.

        Returns
        -------
        Tensor, shape (b, 1, h, w)
            New images, not clipped.
        """
        chosen = draws.chosen(self.probability, 1, 1, 1)
        return images + self.max_change * chosen * draws.signed(1, 1, 1)


def _interpolated_std(grain_px: int) -> float:
    """The deviation that noise of deviation 1 is left with when interpolated to ``grain_px`` times its size.

    Each pixel is the mean of its neighbours in the coarse noise, with weights that depend on where it lies.
    """
    places = [((pixel + 0.5) / grain_px + 0.5) % 1 for pixel in range(grain_px)]
    return sum(place**2 + (1 - place) ** 2 for place in places) / grain_px
