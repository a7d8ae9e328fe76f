"""The networks there are, by the name under which a checkpoint finds the recipe of its own."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, ClassVar, Protocol, runtime_checkable

from torch import nn

from models.errors import InputError
from models.networks.attention_unet import AttentionUNet
from models.networks.monai_network import MonaiNetwork
from models.networks.unet import UNet
from models.networks.unet3plus import UNet3Plus
from models.value_types import require_settings


@runtime_checkable
class NetworkRecipe(Protocol):
    """Frozen dataclass of plain settings whose call builds a network, images (b, 1, h, w) to logits alike.

    In training mode a network may return ``models.networks.outputs.SideOutputs`` instead.
    """

    name: ClassVar[str]

    @property
    def multiple(self) -> int:
        """Number that both sides of an image must be multiples of."""
        ...

    def __call__(self) -> nn.Module:
        """Build the network with weights drawn from torch's current seed.

        Returns
        -------
        nn.Module
            Images (b, 1, h, w) to logits (b, 1, h, w).
        """
        ...


RECIPES: dict[str, type[Any]] = {
    recipe.name: recipe for recipe in (AttentionUNet, MonaiNetwork, UNet, UNet3Plus)
}


def settings_of(recipe: NetworkRecipe) -> dict[str, Any]:
    """Return the fields of a recipe as plain values.

    Parameters
    ----------
    recipe : NetworkRecipe
        Architecture.

    Returns
    -------
    dict
        Values by name.
    """
    settings = dataclasses.asdict(recipe)  # type: ignore[call-overload]
    return dict(settings)


def recipe_of(name: str, settings: Mapping[str, Any]) -> NetworkRecipe:
    """Build a recipe from its name and settings.

    Parameters
    ----------
    name : str
        One of ``RECIPES``.
    settings : mapping
        Fields of the recipe.

    Returns
    -------
    NetworkRecipe
        The recipe.

    Raises
    ------
    InputError
        If the name is unknown or the settings are refused.
    """
    if name not in RECIPES:
        raise InputError(f"network: expected one of {', '.join(sorted(RECIPES))}, received {name!r}")
    try:
        require_settings(RECIPES[name], settings, name)
    except InputError as refusal:
        raise InputError(f"network: expected settings of {name}, received others ({refusal})") from refusal
    recipe: NetworkRecipe = RECIPES[name](**settings)
    return recipe
