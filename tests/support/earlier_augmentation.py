"""The augmentation of version 0.1, one function with flat settings: what today's must equal bit by bit."""

from __future__ import annotations

import math

import torch
from torch import Generator, Tensor
from torch.nn import functional

DEFAULTS = {
    "flip": 0.5,
    "affine": 0.5,
    "rotation_deg": 10.0,
    "scale": 0.15,
    "shift": 0.08,
    "shear": 0.05,
    "elastic": 0.1,
    "elastic_shift": 0.04,
    "elastic_nodes": 5,
    "brightness": 0.3,
    "brightness_shift": 0.1,
    "contrast": 0.3,
    "contrast_factor": 0.3,
    "gamma": 0.3,
    "gamma_factor": 0.4,
    "speckle": 0.1,
    "speckle_deviation": 0.125,
    "speckle_grain_px": 2,
    "depth_gain": 0.2,
    "depth_gain_factor": 0.5,
}


def augmented(
    images: Tensor, masks: Tensor, generator: Generator, **settings: float
) -> tuple[Tensor, Tensor]:
    """Images (b, 1, h, w) and masks on the CPU, changed as ``settings`` (else the defaults) say."""
    s = {**DEFAULTS, **settings}
    if s["flip"] or s["affine"] or s["elastic"]:
        images, masks = _moved(images, masks, generator, s)
    return _redisplayed(_reechoed(images, generator, s), generator, s), masks


def _moved(images: Tensor, masks: Tensor, generator: Generator, s: dict[str, float]) -> tuple[Tensor, Tensor]:
    count, _, height, width = images.shape
    theta = _theta(count, width / height, generator, s)
    down, across = ((torch.arange(side) + 0.5) * (2 / side) - 1 for side in (height, width))
    grid = theta[:, :, 0:1, None] * across + (theta[:, :, 1:2, None] * down[:, None] + theta[:, :, 2:3, None])
    if s["elastic"]:
        nodes = int(s["elastic_nodes"])
        signed = 2 * torch.rand((count, 2, nodes, nodes), generator=generator) - 1
        coarse = 2 * s["elastic_shift"] * signed * _chosen(s["elastic"], (count, 1, 1, 1), generator)
        rows, columns = (_smooth(nodes, side) for side in (height, width))
        grid = grid + rows @ coarse @ columns.T
    both = torch.cat([images, masks], dim=1)
    moved = functional.grid_sample(both, grid.permute(0, 2, 3, 1), align_corners=False)
    return moved[:, :1].clamp(0, 1), (moved[:, 1:] >= 0.5).to(masks.dtype)


def _theta(count: int, aspect: float, generator: Generator, s: dict[str, float]) -> Tensor:
    def signed(*shape: int) -> Tensor:
        return 2 * torch.rand((count, *shape), generator=generator) - 1

    active = _chosen(s["affine"], (count,), generator)
    angle = active * signed() * math.radians(s["rotation_deg"])
    scale = _factor(s["scale"], active * signed())
    shear = active * signed() * s["shear"]
    mirror = 1 - 2 * _chosen(s["flip"], (count,), generator)
    cos, sin = torch.cos(angle) / scale, torch.sin(angle) / scale
    theta = torch.zeros(count, 2, 3)
    theta[:, 0, 0] = mirror * cos
    theta[:, 0, 1] = mirror * (shear * cos - sin) / aspect
    theta[:, 1, 0] = sin * aspect
    theta[:, 1, 1] = shear * sin + cos
    theta[:, :, 2] = 2 * s["shift"] * active[:, None] * signed(2)
    return theta


def _reechoed(images: Tensor, generator: Generator, s: dict[str, float]) -> Tensor:
    count, _, height, width = images.shape
    each = (count, 1, 1, 1)
    if s["speckle"]:
        grain = int(s["speckle_grain_px"])
        noise = torch.randn((count, 1, -(-height // grain), -(-width // grain)), generator=generator)
        noise = functional.interpolate(noise, size=(height, width), mode="bilinear", align_corners=False)
        places = [((pixel + 0.5) / grain + 0.5) % 1 for pixel in range(grain)]
        amount = s["speckle_deviation"] / (sum(x**2 + (1 - x) ** 2 for x in places) / grain)
        images = images * (1 + amount * _chosen(s["speckle"], each, generator) * noise)
    if s["depth_gain"]:
        slope = _chosen(s["depth_gain"], each, generator) * (2 * torch.rand(each, generator=generator) - 1)
        images = images * _factor(s["depth_gain_factor"], slope * torch.linspace(-1, 1, height)[:, None])
    return images.clamp(0, 1)


def _redisplayed(images: Tensor, generator: Generator, s: dict[str, float]) -> Tensor:
    each = (len(images), 1, 1, 1)

    def random(name: str) -> Tensor:
        return _chosen(s[name], each, generator) * (2 * torch.rand(each, generator=generator) - 1)

    if s["gamma"]:
        images = images ** _factor(s["gamma_factor"], random("gamma"))
    if s["contrast"]:
        factor = _factor(s["contrast_factor"], random("contrast"))
        images = images * factor + images.mean(dim=(1, 2, 3), keepdim=True) * (1 - factor)
    if s["brightness"]:
        # The order of the products is part of the last bit.
        chosen = _chosen(s["brightness"], each, generator)
        images = images + s["brightness_shift"] * chosen * (2 * torch.rand(each, generator=generator) - 1)
    return images.clamp(0, 1)


def _chosen(probability: float, shape: tuple[int, ...], generator: Generator) -> Tensor:
    return (torch.rand(shape, generator=generator) < probability).float()


def _factor(amount: float, signed: Tensor) -> Tensor:
    return torch.exp(math.log1p(amount) * signed)


def _smooth(nodes: int, count: int) -> Tensor:
    each = torch.eye(nodes)[:, None, :, None]
    return functional.interpolate(each, size=(count, 1), mode="bicubic", align_corners=True)[:, 0, :, 0].T
