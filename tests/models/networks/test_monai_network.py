import sys

import pytest
import torch

from models.errors import InputError
from models.networks.monai_network import NETWORKS, MonaiNetwork
from models.networks.unet import UNet


def parameters(recipe) -> int:
    with torch.device("meta"):
        return sum(parameter.numel() for parameter in recipe().parameters())


@pytest.mark.parametrize("network", NETWORKS)
def test_every_network_gives_logits_at_the_least_size_of_its_multiple(network: str) -> None:
    recipe = MonaiNetwork(network, width=8)
    size = 2 * recipe.multiple
    for module in (recipe(), recipe().eval()):
        logits = module(torch.rand(2, 1, size, size + recipe.multiple))
        assert isinstance(logits, torch.Tensor) and logits.shape == (2, 1, size, size + recipe.multiple)


def test_basic_unet_is_monais_own() -> None:
    from monai.networks.nets import BasicUNet

    peer = BasicUNet(2, 1, 1, features=(4, 8, 16, 32, 64, 4))
    ours = MonaiNetwork("BasicUNet", width=4)()
    ours.inner.load_state_dict(peer.state_dict())
    images = torch.rand(2, 1, 32, 32)
    torch.testing.assert_close(ours(images), peer(images))


@pytest.mark.parametrize("network", ["BasicUNet", "AttentionUnet", "DynUNet"])
def test_width_gives_about_the_parameters_of_our_unet(network: str) -> None:
    assert parameters(MonaiNetwork(network, width=16)) == pytest.approx(parameters(UNet(width=16)), rel=0.03)


@pytest.mark.parametrize(
    ("network", "settings", "multiple"),
    [
        ("BasicUNet", {}, 16),
        ("UNet", {}, 16),
        ("UNet", {"channels": [4, 8, 16], "strides": [2, 4]}, 8),
        ("AttentionUnet", {"channels": (4, 8), "strides": ((2, 3),)}, 6),
        ("SegResNet", {}, 8),
        ("SegResNet", {"blocks_down": [1, 1], "blocks_up": [1]}, 2),
    ],
)
def test_multiple(network: str, settings: dict[str, object], multiple: int) -> None:
    assert MonaiNetwork(network, 8, settings).multiple == multiple


def test_settings_go_before_the_width_and_are_passed_on() -> None:
    recipe = MonaiNetwork("BasicUNet", 8, {"features": [4] * 6, "norm": ["batch", {"affine": False}]})
    network = recipe()
    assert network.inner.final_conv.in_channels == 4
    norms = [module for module in network.modules() if isinstance(module, torch.nn.BatchNorm2d)]
    assert norms and not any(norm.affine for norm in norms)


def test_settings_are_the_recipes_own_and_equal_however_they_were_written() -> None:
    given = {"features": [4] * 6}
    recipe = MonaiNetwork("BasicUNet", 8, given)
    given["features"].append(5)
    assert recipe == MonaiNetwork("BasicUNet", 8, {"features": (4,) * 6})
    assert hash(recipe) == hash(MonaiNetwork("BasicUNet", 8, {"features": (4,) * 6}))


def test_without_monai_the_error_says_how_to_get_it(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "monai", None)
    monkeypatch.setitem(sys.modules, "monai.networks", None)
    recipe = MonaiNetwork("BasicUNet")
    with pytest.raises(InputError, match=r"network: expected the package monai .*pip install monai"):
        recipe()


def test_refuses_sizes_with_the_multiple_it_needs() -> None:
    with pytest.raises(InputError, match="multiples of 16, 32 at least, received 32 x 40"):
        MonaiNetwork("BasicUNet", 4)()(torch.rand(1, 1, 32, 40))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"network": "VNet"}, "network: expected one of AttentionUnet, .* received 'VNet'"),
        ({"width": 0}, "width: expected at least 1 channel, received 0"),
        ({"settings": {"in_channels": 3}}, "settings: expected none of .* received in_channels"),
        ({"network": "DynUNet", "settings": {"deep_supervision": True}}, "deep_supervision to be false"),
        ({"settings": {"act": {"name": torch.nn.ReLU}}}, "settings.act.name: expected text, numbers"),
        (
            {"network": "UNet", "settings": {"strides": [2, 0]}},
            r"strides of at least 1, .* received \[2, 0\]",
        ),
    ],
)
def test_refuses_settings(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        MonaiNetwork(**{"network": "BasicUNet", **arguments})


@pytest.mark.parametrize(
    "settings", [{"layers": 3}, {"norm": "nonsense"}, {"features": [4, 8]}, {"upsample": "nonsense"}]
)
def test_settings_that_the_class_refuses_are_the_users_mistake(settings: dict[str, object]) -> None:
    with pytest.raises(InputError, match="settings: expected those of monai's BasicUNet, received others"):
        MonaiNetwork("BasicUNet", 4, settings)()


def test_tables_tell_monai_networks_apart() -> None:
    assert MonaiNetwork("BasicUNet").label == "monai BasicUNet"
    assert MonaiNetwork("SegResNet").label == "monai SegResNet"
