import numpy as np
import pytest
import torch
from torch import Tensor, nn

from models.averaging import ChannelTies, channel_ties, permuted
from models.errors import InputError
from models.networks.attention_unet import AttentionUNet
from models.networks.monai_network import MonaiNetwork
from models.networks.outputs import SideOutputs
from models.networks.registry import NetworkRecipe
from models.networks.unet import UNet
from models.networks.unet3plus import UNet3Plus

RECIPES = {
    "unet": UNet(6, 4),
    "unet_group": UNet(16, 3, "group"),
    "unet_none": UNet(6, 3, "none"),
    "attention_unet": AttentionUNet(4, 4, "instance"),
    "attention_unet_full_size_gate": AttentionUNet(4, 3, gated_levels=[0, 1]),
    "unet3plus": UNet3Plus(4, 4, deep_supervision=True, classification_guided=True),
    "unet3plus_group": UNet3Plus(8, 3, "group"),
    "monai_basic_unet": MonaiNetwork("BasicUNet", 4),
    "monai_residual": MonaiNetwork("SegResNet", 8),
    "monai_shared_layers": MonaiNetwork("DynUNet", 4),
}


def shuffled(ties: ChannelTies, seed: int = 0) -> dict[int, np.ndarray]:
    """A random order of every group's channels, within what may change places."""
    generator = np.random.default_rng(seed)
    permutations = {}
    for group in ties.movable:
        taken = np.arange(ties.size(group))
        for label in np.unique(ties.blocks[group]):
            channels = np.flatnonzero(ties.blocks[group] == label)
            taken[channels] = generator.permutation(channels)
        permutations[group] = taken
    return permutations


def disturbed(network: nn.Module) -> nn.Module:
    """The network in 64 bits with no two channels alike, in weights, biases, scales and statistics."""
    network.double()
    with torch.no_grad():
        for tensor in network.state_dict().values():
            if tensor.is_floating_point():
                tensor.add_(0.1 * torch.rand_like(tensor))
    return network


@pytest.mark.parametrize("recipe", RECIPES.values(), ids=RECIPES)
def test_a_permuted_network_computes_the_same(recipe: NetworkRecipe) -> None:
    torch.manual_seed(0)
    network = disturbed(recipe())
    size = 2 * recipe.multiple
    images = torch.rand(2, 1, size, size, dtype=torch.float64)
    before = network.eval()(images)
    ties = channel_ties(recipe)
    weights = {name: tensor.clone() for name, tensor in network.state_dict().items()}
    moved = permuted(weights, ties, shuffled(ties))
    # The head reads permuted channels; hidden weights are really elsewhere.
    assert (
        sum(not torch.equal(moved[name], weights[name]) for name in ties.parameters)
        > len(ties.parameters) // 2
    )
    network.load_state_dict(moved)
    torch.testing.assert_close(network(images), before, rtol=1e-9, atol=1e-9)


def test_side_outputs_in_training_are_the_same_as_well() -> None:
    torch.manual_seed(0)
    recipe = UNet3Plus(4, 3, dropout=0.0, deep_supervision=True)
    network, images = disturbed(recipe()).train(), torch.rand(2, 1, 8, 8, dtype=torch.float64)
    before = network(images)
    assert isinstance(before, SideOutputs) and len(before.sides) == 2
    ties = channel_ties(recipe)
    network.load_state_dict(permuted(network.state_dict(), ties, shuffled(ties)))
    after = network(images)
    for one, other in zip((before.logits, *before.sides), (after.logits, *after.sides), strict=True):
        torch.testing.assert_close(one, other, rtol=1e-9, atol=1e-9)


def test_the_ties_of_a_small_u_net_by_hand() -> None:
    ties = channel_ties(UNet(4, 2))
    first_inner, skip = ties.axes["encoder.0.0.weight"][0][0], ties.axes["encoder.0.3.weight"][0][0]
    up = ties.axes["decoder.0.up.weight"][1][0]
    # The joined convolution reads the skip's channels, then those of the up-convolution.
    assert ties.axes["decoder.0.convolutions.0.weight"][1] == (skip, up)
    assert ties.axes["encoder.1.0.weight"][1] == ties.axes["encoder.0.4.running_var"][0] == (skip,)
    assert ties.axes["encoder.0.3.weight"][1] == ties.axes["encoder.0.1.bias"][0] == (first_inner,)
    # Two in every double convolution, of which there are three, and the up-convolution.
    assert len(ties.movable) == 7
    assert "encoder.0.4.running_var" not in ties.parameters and "head.weight" in ties.parameters


def test_the_gate_of_an_attention_u_net_ties_both_its_signals() -> None:
    ties = channel_ties(AttentionUNet(4, 3))
    gate = "gates.1."
    assert ties.axes[f"{gate}skip.weight"][0] == ties.axes[f"{gate}gating.weight"][0]
    assert ties.axes[f"{gate}psi.weight"][1] == ties.axes[f"{gate}skip.weight"][0]
    assert ties.axes[f"{gate}psi.weight"][0][0] not in ties.movable


def test_channels_normalised_in_a_group_stay_in_it() -> None:
    ties = channel_ties(UNet(16, 2, "group"))
    group = ties.axes["encoder.0.0.weight"][0][0]
    assert ties.blocks[group].tolist() == [channel // 2 for channel in range(16)]
    # Eight channels in eight groups: none can move.
    fixed = channel_ties(UNet(8, 2, "group"))
    assert fixed.axes["encoder.0.0.weight"][0][0] not in fixed.movable


class Recipe:
    """A network given as a function, for what no recipe of ours does."""

    name, multiple = "tried", 2

    def __init__(self, network: type[nn.Module]) -> None:
        self.network = network

    def __call__(self) -> nn.Module:
        return self.network()


class Flipping(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.a, self.b = nn.Conv2d(1, 4, 1), nn.Conv2d(4, 1, 1)

    def forward(self, images: Tensor) -> Tensor:
        result: Tensor = self.b(self.a(images).flip(1))
        return result


class Spare(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.a, self.spare = nn.Conv2d(1, 1, 1), nn.Conv2d(4, 4, 1)

    def forward(self, images: Tensor) -> Tensor:
        result: Tensor = self.a(images)
        return result


class Grouped(nn.Sequential):
    def __init__(self) -> None:
        super().__init__(nn.Conv2d(1, 4, 1), nn.Conv2d(4, 4, 1, groups=2), nn.Conv2d(4, 1, 1))


def test_refuses_what_it_can_not_follow() -> None:
    with pytest.raises(InputError, match="expected operations whose channels can be followed, found flip"):
        channel_ties(Recipe(Flipping))
    with pytest.raises(
        InputError, match=r"expected all weights to be used on an image, found spare\.weight unused"
    ):
        channel_ties(Recipe(Spare))
    with pytest.raises(InputError, match="expected layers whose channels can be followed, found Conv2d"):
        channel_ties(Recipe(Grouped))
