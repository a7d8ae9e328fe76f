"""An augmentation: transforms in the order of a list, drawn apart for each image of a batch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from torch import Generator, Tensor

from models.array_types import Float32
from models.errors import InputError
from models.training.augmentation.intensity import Brightness, Contrast, DepthGain, Gamma, Speckle
from models.training.augmentation.protocols import (
    DisplacementTransform,
    IntensityTransform,
    LinearTransform,
    RandomDraws,
)
from models.training.augmentation.spatial import Affine, Elastic, Flip, resample

DEFAULT_TRANSFORMS = (
    Affine(),
    Flip(),
    Elastic(),
    Speckle(),
    DepthGain(),
    Gamma(),
    Contrast(),
    Brightness(),
)


@dataclass(frozen=True)
class Augmentation:
    """Random transforms of a batch of training images and masks.

    Parameters
    ----------
    transforms : sequence of transforms
        Spatial transforms (of images and masks, in one interpolation) first, then transforms of grey values (of
        images alone, one after the other). Their order is that of the random numbers, too. Empty for none.

    Raises
    ------
    InputError
        If something else is in the list, or a spatial transform follows one of grey values.
    """

    transforms: Sequence[Any] = DEFAULT_TRANSFORMS

    def __post_init__(self) -> None:
        object.__setattr__(self, "transforms", tuple(self.transforms))
        begun = False
        for index, each in enumerate(self.transforms):
            is_intensity = isinstance(each, IntensityTransform)
            if not (is_intensity or isinstance(each, (LinearTransform, DisplacementTransform))):
                raise InputError(f"transforms[{index}]: expected a transform, received {each!r}")
            if begun and not is_intensity:
                raise InputError(
                    f"transforms[{index}]: expected spatial transforms before those of grey values, received "
                    f"{type(each).__name__} after {type(self.transforms[index - 1]).__name__}"
                )
            begun = is_intensity

    def __call__(
        self,
        images: Float32[Tensor, "b 1 h w"],
        masks: Float32[Tensor, "b 1 h w"],
        generator: Generator,
        *,
        binary: bool = True,
    ) -> tuple[Float32[Tensor, "b 1 h w"], Float32[Tensor, "b 1 h w"]]:
        """Transform a batch.

        Parameters
        ----------
        images : Tensor, shape (b, 1, h, w)
            Grey values of 0 to 1.
        masks : Tensor, shape (b, 1, h, w)
            Values 0 and 1, or probabilities.
        generator : torch.Generator
            Source of all random numbers.
        binary : bool, optional
            Whether ``masks`` are masks of 0 and 1, as against probabilities.

        Returns
        -------
        images : Tensor, shape (b, 1, h, w)
            Grey values of 0 to 1.
        masks : Tensor, shape (b, 1, h, w)
            Values 0 and 1, or probabilities.
        """
        draws = RandomDraws(len(images), images.device, generator)
        linear, displacements, intensity = self._by_kind
        if linear or displacements:
            images, masks = resample(images, masks, linear, displacements, draws, binary=binary)
        before: IntensityTransform | None = None
        for each in intensity:
            if before is not None and before.stage != each.stage:
                images = images.clamp(0, 1)
            images = each(images, draws)
            before = each
        return (images.clamp(0, 1) if before is not None else images), masks

    @cached_property
    def _by_kind(
        self,
    ) -> tuple[
        tuple[LinearTransform, ...], tuple[DisplacementTransform, ...], tuple[IntensityTransform, ...]
    ]:
        return (
            tuple(each for each in self.transforms if isinstance(each, LinearTransform)),
            tuple(each for each in self.transforms if isinstance(each, DisplacementTransform)),
            tuple(each for each in self.transforms if isinstance(each, IntensityTransform)),
        )
