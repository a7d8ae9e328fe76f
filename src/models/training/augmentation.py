"""Random changes to a batch of training images and masks: where the vessel is, and how the scanner shows it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Generator, Tensor
from torch.nn import functional

from models.array_types import Float32
from models.errors import InputError

PROBABILITIES = (
    "flip",
    "affine",
    "elastic",
    "brightness",
    "contrast",
    "gamma",
    "speckle",
    "depth_gain",
)
AMOUNTS = (
    "rotation_deg",
    "scale",
    "shift",
    "shear",
    "elastic_shift",
    "brightness_shift",
    "contrast_factor",
    "gamma_factor",
    "speckle_deviation",
    "depth_gain_factor",
)


@dataclass(frozen=True)
class Augmentation:
    """What may happen to each image of a batch, each with its own probability and drawn apart for each image.

    The fields named like a change are its probability (0 to 1). Geometry, for images and masks alike: ``flip`` left
    to right; ``affine``, a turn of up to ``rotation_deg``, a scale within 1 to 1 + ``scale`` or its inverse, a shift
    of up to ``shift`` of the image's side, a ``shear`` of up to that tangent; ``elastic``, smooth random shifts of up
    to ``elastic_shift`` of the side between ``elastic_nodes`` control points a side. Grey values, images only:
    ``brightness`` adds up to ``brightness_shift``; ``contrast`` and ``gamma`` scale by, and raise to, a factor within
    1 to 1 + their ``_factor`` or its inverse; ``speckle`` multiplies by 1 plus noise of deviation
    ``speckle_deviation`` with grains of ``speckle_grain_px``; ``depth_gain`` lets the gain run evenly in decibels
    from the top to the bottom, between up to 1 + its factor and the inverse. What has probability 0 costs nothing.
    """

    flip: float = 0.5
    affine: float = 0.5
    rotation_deg: float = 10.0
    scale: float = 0.15
    shift: float = 0.08
    shear: float = 0.05
    elastic: float = 0.1
    elastic_shift: float = 0.04
    elastic_nodes: int = 5
    brightness: float = 0.3
    brightness_shift: float = 0.1
    contrast: float = 0.3
    contrast_factor: float = 0.3
    gamma: float = 0.3
    gamma_factor: float = 0.4
    speckle: float = 0.1
    speckle_deviation: float = 0.125
    speckle_grain_px: int = 2
    depth_gain: float = 0.2
    depth_gain_factor: float = 0.5

    def __post_init__(self) -> None:
        for name in PROBABILITIES:
            if not 0 <= getattr(self, name) <= 1:
                raise InputError(f"{name}: expected a probability 0 to 1, received {getattr(self, name)}")
        for name in AMOUNTS:
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) >= 0):
                raise InputError(f"{name}: expected a number from 0, received {getattr(self, name)}")
        for name, least in (("elastic_nodes", 2), ("speckle_grain_px", 1)):
            if getattr(self, name) < least:
                raise InputError(f"{name}: expected at least {least}, received {getattr(self, name)}")

    def __call__(
        self,
        images: Float32[Tensor, "b 1 h w"],
        masks: Float32[Tensor, "b 1 h w"],
        generator: Generator,
    ) -> tuple[Float32[Tensor, "b 1 h w"], Float32[Tensor, "b 1 h w"]]:
        """Change images of values 0 to 1 and their masks of 0 and 1; all chance comes from ``generator``."""
        draw = _Draw(len(images), images.device, generator)
        if self.flip or self.affine or self.elastic:
            images, masks = self._move(images, masks, draw)
        return self._redisplay(self._reecho(images, draw), draw), masks

    def _move(self, images: Tensor, masks: Tensor, draw: _Draw) -> tuple[Tensor, Tensor]:
        """Flip, affine and elastic in one sampling, so that an image is interpolated once."""
        height, width = images.shape[-2:]
        theta = self._affine(draw, width / height)[..., None]
        down, across = (_pixel_centres(side, images.device) for side in (height, width))
        # (b, 2, h, w): where each output pixel is taken from, x before y.
        grid = theta[:, :, 0:1] * across + (theta[:, :, 1:2] * down[:, None] + theta[:, :, 2:3])
        if self.elastic:
            nodes = self.elastic_nodes
            coarse = (
                2 * self.elastic_shift * draw.signed(2, nodes, nodes) * draw.chosen(self.elastic, 1, 1, 1)
            )
            rows, columns = (_smooth_weights(nodes, side, images.device) for side in (height, width))
            grid = grid + rows @ coarse @ columns.T
        both = torch.cat([images, masks], dim=1)
        moved = functional.grid_sample(both, grid.permute(0, 2, 3, 1), align_corners=False)
        return moved[:, :1].clamp(0, 1), (moved[:, 1:] >= 0.5).to(masks.dtype)

    def _affine(self, draw: _Draw, aspect: float) -> Tensor:
        """Where each output point is taken from, (b, 2, 3), in grid coordinates of -1 to 1."""
        active = draw.chosen(self.affine)
        angle = active * draw.signed() * math.radians(self.rotation_deg)
        scale = _factor(self.scale, active * draw.signed())
        shear = active * draw.signed() * self.shear
        mirror = 1 - 2 * draw.chosen(self.flip)
        cos, sin = torch.cos(angle) / scale, torch.sin(angle) / scale
        theta = torch.zeros(len(angle), 2, 3, device=angle.device)
        theta[:, 0, 0] = mirror * cos
        theta[:, 0, 1] = mirror * (shear * cos - sin) / aspect
        theta[:, 1, 0] = sin * aspect
        theta[:, 1, 1] = shear * sin + cos
        theta[:, :, 2] = 2 * self.shift * active[:, None] * draw.signed(2)
        return theta

    def _reecho(self, images: Tensor, draw: _Draw) -> Tensor:
        """Speckle and gain: they belong to the echo, so they come before what the display does."""
        height, width = images.shape[-2:]
        if self.speckle:
            grain = self.speckle_grain_px
            noise = draw.normal(1, -(-height // grain), -(-width // grain))
            noise = functional.interpolate(noise, size=(height, width), mode="bilinear", align_corners=False)
            amount = self.speckle_deviation / _interpolated_deviation(grain)
            images = images * (1 + amount * draw.chosen(self.speckle, 1, 1, 1) * noise)
        if self.depth_gain:
            slope = draw.chosen(self.depth_gain, 1, 1, 1) * draw.signed(1, 1, 1)
            depth = torch.linspace(-1, 1, height, device=images.device)[:, None]
            images = images * _factor(self.depth_gain_factor, slope * depth)
        return images.clamp(0, 1)

    def _redisplay(self, images: Tensor, draw: _Draw) -> Tensor:
        """Gamma, contrast and brightness."""
        if self.gamma:
            chosen = draw.chosen(self.gamma, 1, 1, 1)
            images = images ** _factor(self.gamma_factor, chosen * draw.signed(1, 1, 1))
        if self.contrast:
            chosen = draw.chosen(self.contrast, 1, 1, 1)
            factor = _factor(self.contrast_factor, chosen * draw.signed(1, 1, 1))
            mean = images.mean(dim=(1, 2, 3), keepdim=True)
            images = images * factor + mean * (1 - factor)
        if self.brightness:
            chosen = draw.chosen(self.brightness, 1, 1, 1)
            images = images + self.brightness_shift * chosen * draw.signed(1, 1, 1)
        return images.clamp(0, 1)


@dataclass(frozen=True)
class _Draw:
    """Random numbers for each of ``count`` images, drawn where the generator lives."""

    count: int
    device: torch.device
    generator: Generator

    def signed(self, *shape: int) -> Tensor:
        """Uniform between -1 and 1."""
        return 2 * self._uniform(*shape) - 1

    def normal(self, *shape: int) -> Tensor:
        """Normal with deviation 1."""
        size = (self.count, *shape)
        return torch.randn(size, generator=self.generator, device=self.generator.device).to(self.device)

    def chosen(self, probability: float, *shape: int) -> Tensor:
        """1 with that probability, else 0."""
        return (self._uniform(*shape) < probability).float()

    def _uniform(self, *shape: int) -> Tensor:
        size = (self.count, *shape)
        return torch.rand(size, generator=self.generator, device=self.generator.device).to(self.device)


def _factor(amount: float, signed: Tensor) -> Tensor:
    """From 1 / (1 + amount) at -1 through 1 at 0 to 1 + amount at 1."""
    return torch.exp(math.log1p(amount) * signed)


def _pixel_centres(count: int, device: torch.device) -> Tensor:
    """Where pixels lie along a side that runs from -1 to 1."""
    return (torch.arange(count, device=device) + 0.5) * (2 / count) - 1


def _smooth_weights(nodes: int, count: int, device: torch.device) -> Tensor:
    """(count, nodes): cubic interpolation from nodes at even distances, the outermost at the side's ends.

    A product with one such matrix a side interpolates a plane in a tenth of the time of the general operation.
    """
    each = torch.eye(nodes, device=device)[:, None, :, None]
    smooth = functional.interpolate(each, size=(count, 1), mode="bicubic", align_corners=True)
    return smooth[:, 0, :, 0].T


def _interpolated_deviation(grain: int) -> float:
    """The deviation that noise of deviation 1 is left with when interpolated to ``grain`` times its size.

    Each pixel is the mean of its neighbours in the coarse noise, with weights that depend on where it lies.
    """
    places = [((pixel + 0.5) / grain + 0.5) % 1 for pixel in range(grain)]
    return sum(place**2 + (1 - place) ** 2 for place in places) / grain
