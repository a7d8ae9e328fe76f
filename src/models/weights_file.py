"""Files of tensors, text and numbers alone: read so that no file of anyone's can run code, and checked before use."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from models.archives import require_whole_archive
from models.errors import InputError
from models.networks.registry import NetworkRecipe

# Torch raises anything for a file that it can't read.
UNREADABLE = (Exception,)


def read_weights_file(path: Path, versions: Mapping[str, int], kind: str) -> dict[str, Any]:
    """Read a file that this program wrote with ``torch.save``.

    Parameters
    ----------
    path : Path
        File.
    versions : mapping of str to int
        The formats that are accepted, each with the version that this program reads.
    kind : str
        What the file is expected to be, for messages.

    Returns
    -------
    dict
        Its content: tensors on the CPU, text, numbers, lists and mappings.

    Raises
    ------
    InputError
        If the file is missing, damaged, of another program or of another version.
    """
    if not path.is_file():
        raise InputError(f"{path}: expected a {kind} file, found none")
    try:
        require_whole_archive(path)
        content = torch.load(path, map_location="cpu", weights_only=True)
    except UNREADABLE as error:
        raise InputError(
            f"{path}: expected a {kind} of this program, received a file that is damaged or of another kind"
        ) from error
    found = content.get("format") if isinstance(content, dict) else None
    if not isinstance(content, dict) or not isinstance(found, str) or found not in versions:
        raise InputError(f"{path}: expected a {kind} of this program, received another program's file")
    if content.get("version") != versions[found]:
        raise InputError(
            f"{path}: expected a {kind} of version {versions[found]}, received version {content.get('version')}"
        )
    return content


def are_weights(content: object) -> bool:
    """Tell whether something is a state dict.

    Parameters
    ----------
    content : object
        What a file holds in the place of weights.

    Returns
    -------
    bool
        True for a mapping of names to tensors.
    """
    return isinstance(content, Mapping) and all(
        isinstance(name, str) and isinstance(tensor, Tensor) for name, tensor in content.items()
    )


def require_fitting(recipe: NetworkRecipe, weights: Mapping[str, Tensor], where: object) -> None:
    """Check that weights are those of a network: all its names, and no other, in its shapes.

    Parameters
    ----------
    recipe : NetworkRecipe
        Architecture.
    weights : mapping of str to Tensor
        State dict.
    where : object
        File that the weights are from, for the message.

    Raises
    ------
    InputError
        If a tensor is missing, one too many, or of another shape.
    """
    expected = {name: tuple(t.shape) for name, t in _without_weights(recipe).state_dict().items()}
    received = {name: tuple(t.shape) for name, t in weights.items()}
    for name in sorted(expected.keys() | received.keys()):
        if expected.get(name) != received.get(name):
            raise InputError(
                f"{where}: expected weights of {recipe} with {name} {expected.get(name, 'absent')}, "
                f"received {received.get(name, 'absent')}"
            )


def network_with(recipe: NetworkRecipe, weights: Mapping[str, Tensor]) -> nn.Module:
    """Build a network with given weights; no random number is drawn.

    Parameters
    ----------
    recipe : NetworkRecipe
        Architecture.
    weights : mapping of str to Tensor
        State dict, which is copied.

    Returns
    -------
    nn.Module
        Network in evaluation mode.
    """
    network = _without_weights(recipe)
    network.load_state_dict({name: tensor.clone() for name, tensor in weights.items()}, assign=True)
    return network.eval()


def _without_weights(recipe: NetworkRecipe) -> nn.Module:
    """The network of a recipe with shapes alone: no memory taken, no random number drawn."""
    with torch.random.fork_rng(devices=[]), torch.device("meta"):
        return recipe()
