"""A trained network in one file: its recipe, its weights and the preprocessing they expect.

The file holds tensors, text and numbers alone and is read as such, so that no file of anyone's can run code.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from models.atomic import atomic_write
from models.errors import InputError
from models.networks.registry import NetworkRecipe, recipe_of, settings_of
from models.preprocessing.preprocessing import Preprocessing
from models.weights_file import are_weights, network_with, read_weights_file, require_fitting

FORMAT = "ctus-checkpoint"
VERSION = 1


@dataclass(frozen=True)
class Checkpoint:
    """All that is needed to use a trained network again.

    Parameters
    ----------
    recipe : NetworkRecipe
        Architecture.
    weights : mapping of str to Tensor
        State dict of the network.
    preprocessing : Preprocessing
        Preprocessing that the network expects.
    notes : mapping
        Plain numbers and text on the training.
    """

    recipe: NetworkRecipe
    weights: Mapping[str, Tensor]
    preprocessing: Preprocessing
    notes: Mapping[str, str | int | float] = field(default_factory=dict)

    def save(self, path: Path) -> None:
        """Write the file atomically.

        Parameters
        ----------
        path : Path
            Where the checkpoint is written; an existing file is replaced.
        """
        content = {
            "format": FORMAT,
            "version": VERSION,
            "network": self.recipe.name,
            "settings": settings_of(self.recipe),
            "preprocessing": dataclasses.asdict(self.preprocessing),
            "weights": {name: tensor.detach().cpu().contiguous() for name, tensor in self.weights.items()},
            "notes": dict(self.notes),
        }
        with atomic_write(path) as temporary:
            torch.save(content, temporary)

    @staticmethod
    def load(path: str | Path) -> Checkpoint:
        """Read a checkpoint file.

        Parameters
        ----------
        path : str or Path
            File that ``save`` wrote.

        Returns
        -------
        Checkpoint
            Weights on the CPU.

        Raises
        ------
        InputError
            If the file is missing, damaged, of another program or version, or its weights do not fit its recipe.
        """
        return Checkpoint.of(read_weights_file(Path(path), {FORMAT: VERSION}, "checkpoint"), path)

    @staticmethod
    def of(content: Mapping[str, Any], path: str | Path) -> Checkpoint:
        """Build a checkpoint from what its file holds.

        Parameters
        ----------
        content : mapping
            Content of a file of this format and version.
        path : str or Path
            The file, for messages.

        Returns
        -------
        Checkpoint
            The checkpoint.

        Raises
        ------
        InputError
            If the network is unknown or the weights do not fit its recipe.
        """
        if not are_weights(content.get("weights")):
            raise InputError(f"{path}: expected the weights of a network by name, received something else")
        try:
            recipe = recipe_of(content["network"], content["settings"])
            checkpoint = Checkpoint(
                recipe, content["weights"], Preprocessing(**content["preprocessing"]), content["notes"]
            )
        except (KeyError, TypeError, InputError) as refusal:
            raise InputError(
                f"{path}: expected a checkpoint of a known network, received another ({refusal})"
            ) from refusal
        require_fitting(recipe, checkpoint.weights, path)
        return checkpoint

    def network(self) -> nn.Module:
        """Build the network with these weights.

        Returns
        -------
        nn.Module
            Network on the CPU in evaluation mode.
        """
        return network_with(self.recipe, self.weights)
