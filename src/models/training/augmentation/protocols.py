"""What a transform of an augmentation is: the three kinds, the random numbers they draw, and the checks they share."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, Protocol, runtime_checkable

import torch
from torch import Generator, Tensor

from models.array_types import Float32
from models.errors import InputError


@dataclass(frozen=True)
class RandomDraws:
    """Random numbers for each image of a batch, drawn where the generator lives.

    Parameters
    ----------
    count : int
        Number of images in the batch.
    device : torch.device
        Where the numbers are needed.
    generator : torch.Generator
        Source of all random numbers.
    """

    count: int
    device: torch.device
    generator: Generator

    def signed(self, *shape: int) -> Tensor:
        """Draw uniformly between -1 and 1.

        Parameters
        ----------
        *shape : int
            Shape for one image.

        Returns
        -------
        Tensor, shape (count, *shape)
            Values in [-1, 1).
        """
        return 2 * self._uniform(*shape) - 1

    def normal(self, *shape: int) -> Tensor:
        """Draw from the standard normal distribution.

        Parameters
        ----------
        *shape : int
            Shape for one image.

        Returns
        -------
        Tensor, shape (count, *shape)
            Values of mean 0 and standard deviation 1.
        """
        size = (self.count, *shape)
        return torch.randn(size, generator=self.generator, device=self.generator.device).to(self.device)

    def chosen(self, probability: float, *shape: int) -> Tensor:
        """Draw which images a transform applies to.

        Parameters
        ----------
        probability : float
            Probability of a 1.
        *shape : int
            Shape for one image.

        Returns
        -------
        Tensor, shape (count, *shape)
            1 with that probability, otherwise 0.
        """
        return (self._uniform(*shape) < probability).float()

    def _uniform(self, *shape: int) -> Tensor:
        size = (self.count, *shape)
        return torch.rand(size, generator=self.generator, device=self.generator.device).to(self.device)


@dataclass(frozen=True)
class LinearMap:
    """Linear part of a spatial transform, from output to input coordinates, in which a side runs from -1 to 1.

    Parameters
    ----------
    matrix : Tensor, shape (b, 2, 2)
        One matrix for each image, x before y.
    max_shift : Tensor, shape (b,), or None
        Largest shift along either axis that follows the matrix; None where the transform does not shift.
    """

    matrix: Tensor
    max_shift: Tensor | None = None


@runtime_checkable
class LinearTransform(Protocol):
    """A spatial transform of images and masks by one matrix for each image."""

    def linear(self, draws: RandomDraws, aspect: float) -> LinearMap:
        """Draw the matrices of a batch.

        Parameters
        ----------
        draws : RandomDraws
            Source of the random numbers.
        aspect : float
            Width of the images divided by their height.

        Returns
        -------
        LinearMap
            The identity for images that the transform does not apply to.
        """
        ...


@runtime_checkable
class DisplacementTransform(Protocol):
    """A spatial transform of images and masks by a field of displacements."""

    def displacement(
        self, draws: RandomDraws, height: int, width: int
    ) -> Float32[Tensor, "b 2 {height} {width}"]:
        """Draw the displacement of every pixel of a batch.

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
        ...


@runtime_checkable
class IntensityTransform(Protocol):
    """A transform of grey values, which leaves masks as they are.

    ``stage`` is ``echo`` for what happens to the received signal and ``display`` for what the scanner's
    post-processing does; grey values are clipped to 0 to 1 between the two.
    """

    @property
    def stage(self) -> Literal["echo", "display"]:
        """Where in the imaging chain the transform belongs."""
        ...

    def __call__(self, images: Float32[Tensor, "b 1 h w"], draws: RandomDraws) -> Float32[Tensor, "b 1 h w"]:
        """Change the grey values of a batch.

        Parameters
        ----------
        images : Tensor, shape (b, 1, h, w)
            Images with grey values of about 0 to 1.
        draws : RandomDraws
            Source of the random numbers.

        Returns
        -------
        Tensor, shape (b, 1, h, w)
            New images, not clipped.
        """
        ...


def random_factor(max_change: float, signed: Tensor) -> Tensor:
    """Turn signed random numbers into factors that are symmetric about 1 on a logarithmic scale.

    Parameters
    ----------
    max_change : float
        Largest relative change.
    signed : Tensor
        Values of -1 to 1.

    Returns
    -------
    Tensor
        1 / (1 + max_change) at -1, 1 at 0, 1 + max_change at 1.
    """
    return torch.exp(math.log1p(max_change) * signed)


def require_probability(transform: Any) -> None:
    """Check the field ``probability`` of a transform.

    Parameters
    ----------
    transform : Any
        A transform with a ``probability``.

    Raises
    ------
    InputError
        If it is not between 0 and 1.
    """
    value = transform.probability
    if not 0 <= value <= 1:
        raise InputError(
            f"{type(transform).__name__}.probability: expected a number from 0 to 1, received {value}"
        )


def require_amounts(transform: object, *names: str, minimum: float = 0) -> None:
    """Check that fields of a transform are finite and not too small.

    Parameters
    ----------
    transform : object
        A transform with those fields.
    *names : str
        Names of the fields.
    minimum : float
        Smallest value that is accepted.

    Raises
    ------
    InputError
        If a value is smaller or not finite.
    """
    for name in names:
        value = getattr(transform, name)
        if not (math.isfinite(value) and value >= minimum):
            raise InputError(
                f"{type(transform).__name__}.{name}: expected a number of at least {minimum}, received {value}"
            )
