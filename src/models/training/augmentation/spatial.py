"""Spatial transforms of images and masks: affine, left-right flip, elastic, all applied in one interpolation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from models.array_types import Float32
from models.training.augmentation.protocols import (
    DisplacementTransform,
    LinearMap,
    LinearTransform,
    RandomDraws,
    random_factor,
    require_amounts,
    require_probability,
)


@dataclass(frozen=True)
class Affine:
    """Random rotation, scale, shear and shift.

    Parameters
    ----------
    probability : float
        Probability for each image, 0 to 1.
    max_rotation_deg : float
        Largest rotation in either direction, in degrees.
    max_scale_change : float
        Scale factors lie between 1 / (1 + max_scale_change) and 1 + max_scale_change.
    max_shift : float
        Largest shift along either axis, as a fraction of the image's side.
    max_shear : float
        Largest tangent of the shear angle.

    Raises
    ------
    InputError
        If a value is out of range.
    """

    probability: float = 0.5
    max_rotation_deg: float = 10.0
    max_scale_change: float = 0.15
    max_shift: float = 0.08
    max_shear: float = 0.05

    def __post_init__(self) -> None:
        require_probability(self)
        require_amounts(self, "max_rotation_deg", "max_scale_change", "max_shift", "max_shear")

    def linear(self, draws: RandomDraws, aspect: float) -> LinearMap:
        """Draw one matrix for each image.

        Parameters
        ----------
        draws : RandomDraws
            Source of the random numbers.
        aspect : float
            Width of the images divided by their height; rotations keep shapes where pixels are square.

        Returns
        -------
        LinearMap
            Rotation, scale and shear, and the largest shift.
        """
        active = draws.chosen(self.probability)
        angle = active * draws.signed() * math.radians(self.max_rotation_deg)
        scale = random_factor(self.max_scale_change, active * draws.signed())
        shear = active * draws.signed() * self.max_shear
        cos, sin = torch.cos(angle) / scale, torch.sin(angle) / scale
        matrix = torch.empty(len(angle), 2, 2, device=angle.device)
        matrix[:, 0, 0] = cos
        matrix[:, 0, 1] = (shear * cos - sin) / aspect
        matrix[:, 1, 0] = sin * aspect
        matrix[:, 1, 1] = shear * sin + cos
        # The sides have length 2 in sampling coordinates.
        return LinearMap(matrix, 2 * self.max_shift * active)


@dataclass(frozen=True)
class Flip:
    """Random left-right flip.

    Parameters
    ----------
    probability : float
        Probability for each image, 0 to 1.

    Raises
    ------
    InputError
        If the probability is out of range.
    """

    probability: float = 0.5

    def __post_init__(self) -> None:
        require_probability(self)

    def linear(self, draws: RandomDraws, aspect: float) -> LinearMap:
        """Draw which images are flipped.

        Parameters
        ----------
        draws : RandomDraws
            Source of the random numbers.
        aspect : float
            Not used.

        Returns
        -------
        LinearMap
            Matrices that negate x or change nothing.
        """
        matrix = torch.eye(2, device=draws.device).repeat(draws.count, 1, 1)
        matrix[:, 0, 0] = 1 - 2 * draws.chosen(self.probability)
        return LinearMap(matrix)


@dataclass(frozen=True)
class Elastic:
    """Random smooth displacements, interpolated between control points by cubic convolution.

    Parameters
    ----------
    probability : float
        Probability for each image, 0 to 1.
    max_shift : float
        Largest displacement of a control point along either axis, as a fraction of the image's side.
    control_points : int
        Number of control points along each side, the outermost at the image's border.

    Raises
    ------
    InputError
        If a value is out of range.
    """

    probability: float = 0.1
    max_shift: float = 0.04
    control_points: int = 5

    def __post_init__(self) -> None:
        require_probability(self)
        require_amounts(self, "max_shift")
        require_amounts(self, "control_points", minimum=2)

    def displacement(
        self, draws: RandomDraws, height: int, width: int
    ) -> Float32[Tensor, "b 2 {height} {width}"]:
        """Draw the displacement of every pixel.

        Parameters
        ----------
        draws : RandomDraws
            Source of the random numbers.
        height, width : int
            Size of the images in px.

        Returns
        -------
        Tensor, shape (b, 2, height, width)
            Displacements of the sampled positions, x before y, where a side has length 2.
        """
        count = self.control_points
        shifts = 2 * self.max_shift * draws.signed(2, count, count) * draws.chosen(self.probability, 1, 1, 1)
        rows, columns = (_cubic_weights(count, side, draws.device) for side in (height, width))
        return rows @ shifts @ columns.T


def resample(
    images: Float32[Tensor, "b 1 h w"],
    masks: Float32[Tensor, "b 1 h w"],
    linear: Sequence[LinearTransform],
    displacements: Sequence[DisplacementTransform],
    draws: RandomDraws,
    *,
    binary: bool = True,
) -> tuple[Float32[Tensor, "b 1 h w"], Float32[Tensor, "b 1 h w"]]:
    """Apply spatial transforms to images and masks in one bilinear interpolation.

    Parameters
    ----------
    images : Tensor, shape (b, 1, h, w)
        Images of values 0 to 1.
    masks : Tensor, shape (b, 1, h, w)
        Masks of 0 and 1, or probabilities.
    linear : sequence of LinearTransform
        Their matrices are multiplied in this order; then their shifts are added.
    displacements : sequence of DisplacementTransform
        Their displacements are added last.
    draws : RandomDraws
        Source of the random numbers.
    binary : bool, optional
        Whether masks are thresholded at a half again; probabilities are not.

    Returns
    -------
    images : Tensor, shape (b, 1, h, w)
        Values 0 to 1, 0 where the transformed image has no data.
    masks : Tensor, shape (b, 1, h, w)
        Values 0 and 1, or probabilities.
    """
    height, width = images.shape[-2:]
    maps = [each.linear(draws, width / height) for each in linear]
    # Shifts are drawn after all matrices, so that a training draws the numbers that it always drew.
    shifts = [each.max_shift[:, None] * draws.signed(2) for each in maps if each.max_shift is not None]
    matrix = torch.eye(2, device=images.device).expand(len(images), 2, 2)
    for each in maps:
        matrix = each.matrix @ matrix
    shift = sum(shifts, torch.zeros(1, 2, device=images.device))
    down, across = (_pixel_centres(side, images.device) for side in (height, width))
    from_x, from_y = matrix[..., :1, None], matrix[..., 1:, None]
    # (b, 2, h, w): where each output pixel is sampled, x before y.
    grid = from_x * across + (from_y * down[:, None] + shift[..., None, None])
    for field in displacements:
        grid += field.displacement(draws, height, width)
    both = torch.cat([images, masks], dim=1)
    moved = functional.grid_sample(both, grid.permute(0, 2, 3, 1), align_corners=False)
    after = (moved[:, 1:] >= 0.5).to(masks.dtype) if binary else moved[:, 1:].clamp(0, 1)
    return moved[:, :1].clamp(0, 1), after


def _pixel_centres(count: int, device: torch.device) -> Tensor:
    """Where pixels lie along a side that runs from -1 to 1."""
    return (torch.arange(count, device=device) + 0.5) * (2 / count) - 1


def _cubic_weights(nodes: int, count: int, device: torch.device) -> Tensor:
    """(count, nodes): cubic interpolation from nodes at even distances, the outermost at the side's ends.

    A product with one such matrix a side interpolates a plane in a tenth of the time of the general operation.
    """
    each = torch.eye(nodes, device=device)[:, None, :, None]
    smooth = functional.interpolate(each, size=(count, 1), mode="bicubic", align_corners=True)
    return smooth[:, 0, :, 0].T
