"""Requirements on networks whose weights are combined, and the combination itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from models.errors import InputError
from models.networks.registry import NetworkRecipe
from models.weights import Weights, require_alike


@dataclass(frozen=True, eq=False)
class Member:
    """A trained network that may enter an average.

    Parameters
    ----------
    name : str
        Name in messages and tables, such as ``fold 2``.
    recipe : NetworkRecipe
        Its architecture.
    weights : Weights
        Its state dict.
    start : str or None, optional
        ``weights_digest`` of the weights that its training began from; None where that was not recorded.
    """

    name: str
    recipe: NetworkRecipe
    weights: Weights
    start: str | None = None


def require_averageable(members: Sequence[Member], *, same_start: bool = True) -> None:
    """Require that an average of networks is meaningful.

    Weights of networks that were trained from different starts lie in different basins, and their average is
    no network at all (Frankle et al., ICML 2020).

    Parameters
    ----------
    members : sequence of Member
        At least one network.
    same_start : bool, optional
        Whether all trainings must have begun from the same weights. False after an alignment of the channels.

    Raises
    ------
    InputError
        If there is no member, or if recipes, names, shapes or types of tensors, or starts differ, or a weight
        is not finite.
    """
    if not members:
        raise InputError("members: expected at least one trained network, received none")
    first = members[0]
    for other in members[1:]:
        if other.recipe != first.recipe:
            raise InputError(
                f"architecture of {other.name}: expected that of {first.name}, {first.recipe}, "
                f"received {other.recipe}"
            )
    require_alike({member.name: member.weights for member in members})
    if same_start and len(members) > 1:
        _require_same_start(members)


def _require_same_start(members: Sequence[Member]) -> None:
    for member in members:
        if member.start is None:
            raise InputError(
                f"start of {member.name}: expected the digest of the weights its training began from, found none"
            )
        if member.start != members[0].start:
            raise InputError(
                f"start of {member.name}: expected that of {members[0].name} ({members[0].start}), "
                f"received {member.start}: networks from different starts can't be averaged"
            )


def combination(weights: Sequence[Weights], coefficients: Sequence[float]) -> dict[str, Tensor]:
    """Compute a linear combination of state dicts, in 64 bits, returned in the tensors' own type.

    Tensors that are not floating (counts of batches) have no average: their elementwise maximum is taken.

    Parameters
    ----------
    weights : sequence of Weights
        State dicts that ``require_alike`` accepts.
    coefficients : sequence of float
        One coefficient for each; they sum up to 1 in an average.

    Returns
    -------
    dict of str to Tensor
        The combined state dict.
    """
    combined: dict[str, Tensor] = {}
    for name, like in weights[0].items():
        tensors = [each[name].detach() for each in weights]
        if like.is_floating_point():
            total = torch.zeros_like(tensors[0], dtype=torch.float64)
            for tensor, coefficient in zip(tensors, coefficients, strict=True):
                total.add_(tensor.to(total), alpha=coefficient)
            combined[name] = total.to(like.dtype)
        else:
            largest = tensors[0].clone()
            for tensor in tensors[1:]:
                largest = torch.maximum(largest, tensor.to(largest.device))
            combined[name] = largest
    return combined
