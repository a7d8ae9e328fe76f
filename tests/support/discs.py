"""Batches of discs, and what their masks measure."""

from __future__ import annotations

import torch


def generator(seed: int = 0) -> torch.Generator:
    """A generator on the CPU."""
    return torch.Generator().manual_seed(seed)


def discs(count: int = 16, height: int = 48, width: int = 48, radius: float = 10.0) -> torch.Tensor:
    """Masks (count, 1, height, width) with a disc in the centre."""
    row, column = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
    inside = (row - height / 2) ** 2 + (column - width / 2) ** 2 < radius**2
    return inside.float().expand(count, 1, height, width).clone()


def moments(mask: torch.Tensor) -> tuple[float, float, float]:
    """Area, and deviation along rows and columns, in px."""
    place = torch.argwhere(mask[0] > 0).double()
    row_px, column_px = place.std(dim=0, unbiased=False).tolist()
    return float(mask.sum()), row_px, column_px
