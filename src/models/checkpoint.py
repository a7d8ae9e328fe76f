"""A trained network in one file: its recipe, its weights and the preprocessing they expect.

The file holds tensors, text and numbers alone and is read as such, so that no file of anyone's can run code.
"""

from __future__ import annotations

import dataclasses
import pickle
import zipfile
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

FORMAT = "ctus-checkpoint"
VERSION = 1
# What torch raises for a file that it can't read, by how far it gets.
UNREADABLE = (
    pickle.UnpicklingError,
    zipfile.BadZipFile,
    RuntimeError,
    EOFError,
    OSError,
    ValueError,
    KeyError,
)


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
        content = _read(Path(path))
        if not _are_weights(content.get("weights")):
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
        checkpoint._require_weights_that_fit(path)
        return checkpoint

    def network(self) -> nn.Module:
        """Build the network with these weights.

        Returns
        -------
        nn.Module
            Network on the CPU in evaluation mode.
        """
        network = _without_weights(self.recipe)
        network.load_state_dict({name: tensor.clone() for name, tensor in self.weights.items()}, assign=True)
        return network.eval()

    def _require_weights_that_fit(self, path: str | Path) -> None:
        expected = {name: tuple(t.shape) for name, t in _without_weights(self.recipe).state_dict().items()}
        received = {name: tuple(t.shape) for name, t in self.weights.items()}
        for name in sorted(expected.keys() | received.keys()):
            if expected.get(name) != received.get(name):
                raise InputError(
                    f"{path}: expected weights of {self.recipe} with {name} {expected.get(name, 'absent')}, "
                    f"received {received.get(name, 'absent')}"
                )


def _read(path: Path) -> dict[str, Any]:
    if not path.is_file():
        raise InputError(f"{path}: expected a checkpoint file, found none")
    try:
        _require_undamaged(path)
        content = torch.load(path, map_location="cpu", weights_only=True)
    except UNREADABLE as error:
        raise InputError(
            f"{path}: expected a checkpoint of this program, received a file that is damaged or of another kind"
        ) from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise InputError(f"{path}: expected a checkpoint of this program, received another program's file")
    if content.get("version") != VERSION:
        raise InputError(
            f"{path}: expected a checkpoint of version {VERSION}, received version {content.get('version')}"
        )
    return content


def _require_undamaged(path: Path) -> None:
    """Raise BadZipFile if a checksum in the file doesn't fit: torch writes them but doesn't look at them."""
    with zipfile.ZipFile(path) as archive:
        damaged = archive.testzip()
    if damaged is not None:
        raise zipfile.BadZipFile(damaged)


def _are_weights(content: object) -> bool:
    return isinstance(content, Mapping) and all(
        isinstance(name, str) and isinstance(tensor, Tensor) for name, tensor in content.items()
    )


def _without_weights(recipe: NetworkRecipe) -> nn.Module:
    """The network of a recipe with shapes alone: no memory taken, no random number drawn."""
    with torch.random.fork_rng(devices=[]), torch.device("meta"):
        return recipe()
