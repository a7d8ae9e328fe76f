"""Weights of networks: their type, a digest that tells whether two are the same, and whether several fit each other."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping

import torch
from torch import Tensor

from models.errors import InputError

# A state dict: tensors by name, buffers included.
Weights = Mapping[str, Tensor]


def weights_digest(weights: Weights) -> str:
    """Compute a SHA-256 digest of all tensors, independent of their order and memory layout.

    Names, types, shapes and bytes are included.

    Parameters
    ----------
    weights : Weights
        State dict.

    Returns
    -------
    str
        Hexadecimal digest.
    """
    digest = hashlib.sha256()
    for name in sorted(weights):
        tensor = weights[name].detach().cpu().contiguous()
        digest.update(f"{name}|{tensor.dtype}|{tuple(tensor.shape)}|".encode())
        digest.update(tensor.reshape(-1).view(torch.uint8).numpy().tobytes())
    return digest.hexdigest()


def require_alike(weights: Mapping[str, Weights]) -> None:
    """Require that all state dicts have the same tensors and only finite numbers.

    Parameters
    ----------
    weights : mapping of str to Weights
        State dicts by name; the first is the reference.

    Raises
    ------
    InputError
        If names, shapes or types of tensors differ, or a number is not finite.
    """
    reference_name, reference = next(iter(weights.items()))
    expected = {name: (tuple(tensor.shape), tensor.dtype) for name, tensor in reference.items()}
    for owner, tensors in weights.items():
        received = {name: (tuple(tensor.shape), tensor.dtype) for name, tensor in tensors.items()}
        for name in sorted(expected.keys() | received.keys()):
            if expected.get(name) != received.get(name):
                raise InputError(
                    f"weights of {owner}: expected {name} as in {reference_name}, "
                    f"{_described(expected.get(name))}, received {_described(received.get(name))}"
                )
        for name, tensor in tensors.items():
            if tensor.is_floating_point() and not bool(torch.isfinite(tensor).all()):
                raise InputError(f"weights of {owner}: expected finite numbers, found others in {name}")


def _described(shape_and_type: tuple[tuple[int, ...], torch.dtype] | None) -> str:
    return "absent" if shape_and_type is None else f"{shape_and_type[1]} {shape_and_type[0]}"
