"""Random augmentation of training batches: one small class for each transform, in a list that a configuration shows."""

from models.training.augmentation.intensity import Brightness, Contrast, DepthGain, Gamma, Speckle
from models.training.augmentation.pipeline import DEFAULT_TRANSFORMS, Augmentation
from models.training.augmentation.protocols import (
    DisplacementTransform,
    IntensityTransform,
    LinearMap,
    LinearTransform,
    RandomDraws,
)
from models.training.augmentation.settings import TRANSFORMS, augmentation_of
from models.training.augmentation.spatial import Affine, Elastic, Flip

__all__ = [
    "DEFAULT_TRANSFORMS",
    "TRANSFORMS",
    "Affine",
    "Augmentation",
    "Brightness",
    "Contrast",
    "DepthGain",
    "DisplacementTransform",
    "Elastic",
    "Flip",
    "Gamma",
    "IntensityTransform",
    "LinearMap",
    "LinearTransform",
    "RandomDraws",
    "Speckle",
    "augmentation_of",
]
