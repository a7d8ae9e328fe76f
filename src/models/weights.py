"""Weights of a network: their type, and the digest by which two networks are known to have started from the same."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping

import torch
from torch import Tensor

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
