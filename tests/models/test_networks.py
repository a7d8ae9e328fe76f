import pytest

from models.errors import InputError
from models.networks import RECIPES, recipe_of, settings_of
from models.unet import UNet


def test_a_recipe_is_found_again_by_its_name_and_settings() -> None:
    recipe = UNet(width=12, depth=3, normalisation="instance", dropout=0.25)
    assert recipe_of(recipe.name, settings_of(recipe)) == recipe


def test_every_recipe_is_kept_under_its_own_name() -> None:
    assert RECIPES["unet"] is UNet
    assert all(name == recipe.name for name, recipe in RECIPES.items())


def test_refuses_an_unknown_name_unknown_settings_and_bad_values() -> None:
    with pytest.raises(InputError, match=r"network: expected one of .*unet.*, received 'vnet'"):
        recipe_of("vnet", {})
    with pytest.raises(InputError, match="network: expected settings of unet, received others"):
        recipe_of("unet", {"layers": 3})
    with pytest.raises(InputError, match="width"):
        recipe_of("unet", {"width": -1})
