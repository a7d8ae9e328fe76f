from pathlib import Path

import pytest
import torch

from models.checkpoint import Checkpoint
from models.errors import InputError
from models.networks.attention_unet import AttentionUNet
from models.networks.efficientnet_unet import EfficientNetUNet
from models.networks.monai_network import MonaiNetwork
from models.networks.registry import NetworkRecipe, recipe_of, recipes, settings_of
from models.networks.unet import UNet
from models.networks.unet3plus import UNet3Plus
from models.preprocessing.preprocessing import Preprocessing

EXAMPLES = {
    "attention_unet": AttentionUNet(width=4, depth=3, gated_levels=[0, 1]),
    "monai": MonaiNetwork("UNet", 4, {"channels": (4, 8, 8), "strides": (2, 2), "num_res_units": 1}),
    "unet": UNet(width=12, depth=3, normalisation="instance", dropout=0.25),
    "unet3plus": UNet3Plus(4, 3, deep_supervision=True, classification_guided=True),
}
every_recipe = pytest.mark.parametrize("recipe", EXAMPLES.values(), ids=EXAMPLES)


def test_every_recipe_is_kept_under_its_own_name() -> None:
    assert recipes()["unet"] is UNet
    assert all(name == recipe.name for name, recipe in recipes().items())
    # Its encoder needs larger images than the examples here; tests/models/networks/test_efficientnet_unet.py has it.
    assert sorted(recipes()) == sorted([*EXAMPLES, EfficientNetUNet.name])


@every_recipe
def test_a_recipe_is_found_again_by_its_name_and_settings(recipe: NetworkRecipe) -> None:
    assert isinstance(recipe, NetworkRecipe)
    assert recipe_of(recipe.name, settings_of(recipe)) == recipe


@every_recipe
def test_a_network_comes_back_from_its_checkpoint(recipe: NetworkRecipe, tmp_path: Path) -> None:
    network = recipe().eval()
    Checkpoint(recipe, network.state_dict(), Preprocessing(16)).save(tmp_path / "model.pt")
    loaded = Checkpoint.load(tmp_path / "model.pt")
    images = torch.rand(2, 1, 16, 16)
    assert loaded.recipe == recipe
    torch.testing.assert_close(loaded.network()(images), network(images))


@every_recipe
def test_the_seed_decides_the_weights(recipe: NetworkRecipe) -> None:
    weights = []
    for seed in (0, 0, 1):
        torch.manual_seed(seed)
        weights.append(torch.cat([tensor.flatten() for tensor in recipe().parameters()]))
    assert torch.equal(weights[0], weights[1]) and not torch.equal(weights[0], weights[2])


@every_recipe
def test_an_image_in_use_depends_neither_on_its_batch_nor_on_the_layout(recipe: NetworkRecipe) -> None:
    torch.manual_seed(0)
    network, images = recipe().eval(), torch.rand(3, 1, 16, 24)
    together = network(images)
    assert together.shape == images.shape
    torch.testing.assert_close(network(images[1:2]), together[1:2], rtol=1e-4, atol=1e-5)
    network.to(memory_format=torch.channels_last)
    strided = network(images.contiguous(memory_format=torch.channels_last))
    torch.testing.assert_close(strided, together, rtol=1e-4, atol=1e-5)


@every_recipe
def test_in_16_bits_a_network_says_nearly_the_same(recipe: NetworkRecipe) -> None:
    torch.manual_seed(0)
    network, images = recipe().eval(), torch.rand(2, 1, 16, 16)
    with torch.no_grad(), torch.autocast("cpu", dtype=torch.bfloat16):
        half = network(images).float()
    exact = network(images)
    assert float((half - exact).abs().max()) < 0.1 * float(exact.abs().max())


def test_refuses_an_unknown_name_unknown_settings_and_bad_values() -> None:
    with pytest.raises(InputError, match=r"network: expected one of .*unet.*, received 'vnet'"):
        recipe_of("vnet", {})
    with pytest.raises(InputError, match="network: expected settings of unet, received others"):
        recipe_of("unet", {"layers": 3})
    with pytest.raises(InputError, match="width"):
        recipe_of("unet", {"width": -1})
