import dataclasses

import pytest
import torch
from torch import nn

from models.networks.attention_unet import AttentionUNet
from models.networks.outputs import PresenceBranch, SideOutputs, with_presence
from models.networks.unet import UNet
from models.networks.unet3plus import UNet3Plus

NETWORKS = [
    UNet(width=4, depth=3, presence=True),
    AttentionUNet(width=4, depth=3, presence=True),
    UNet3Plus(width=4, depth=3, classification_guided=True),
]


def images(count: int = 2) -> torch.Tensor:
    return torch.rand(count, 1, 16, 16, generator=torch.Generator().manual_seed(0))


@pytest.mark.parametrize("recipe", NETWORKS, ids=lambda recipe: recipe.name)
def test_presence_is_returned_in_training_and_in_use_where_asked_for(recipe) -> None:
    network = recipe()
    trained = network(images())
    assert isinstance(trained, SideOutputs) and trained.presence is not None
    network.eval()
    plain = network(images())
    assert isinstance(plain, torch.Tensor)
    shown = with_presence(network)(images())
    assert isinstance(shown, SideOutputs) and shown.presence.shape == (2,)
    assert torch.equal(shown.logits, plain)
    assert isinstance(with_presence(network, False)(images()), torch.Tensor)


@pytest.mark.parametrize("recipe", NETWORKS, ids=lambda recipe: recipe.name)
def test_logits_are_gated_by_the_presence(recipe) -> None:
    network = with_presence(recipe().eval())
    with torch.no_grad():
        network.presence[1].bias.fill_(0.0)
        open_gate, logit = torch.sigmoid(network(images()).logits), network(images()).presence
        network.presence[1].bias.fill_(-3.0)
        half_closed = torch.sigmoid(network(images()).logits)
        ratio = torch.sigmoid(logit - 3.0) / torch.sigmoid(logit)
        torch.testing.assert_close(half_closed, open_gate * ratio[:, None, None, None])
        network.presence[1].bias.fill_(-200.0)
        assert (network(images()).logits < -50).all()


@pytest.mark.parametrize("recipe", NETWORKS[:2], ids=lambda recipe: recipe.name)
def test_without_the_option_there_is_no_branch(recipe) -> None:
    network = dataclasses.replace(recipe, presence=False)()
    assert isinstance(network(images()), torch.Tensor)
    assert isinstance(with_presence(network.eval())(images()), torch.Tensor)
    extra = sum(p.numel() for p in recipe().parameters()) - sum(p.numel() for p in network.parameters())
    # One 1x1 convolution of the coarsest level's 16 channels, and its bias.
    assert extra == 17


def test_the_branch_looks_for_a_vessel_anywhere() -> None:
    branch = PresenceBranch(2).eval()
    with torch.no_grad():
        branch[1].weight.copy_(torch.tensor([1.0, -2.0]).reshape(1, 2, 1, 1))
        branch[1].bias.fill_(0.5)
    features = torch.zeros(2, 2, 3, 3)
    features[0, 0, 2, 1], features[1, 1] = 4.0, 1.0
    assert branch(features).tolist() == [4.5, -1.5]


def test_networks_without_a_branch_are_left_alone() -> None:
    network = nn.Conv2d(1, 1, 1)
    assert with_presence(network) is network and isinstance(network(images()), torch.Tensor)


def test_sides_and_presence_are_there_or_not_but_always_named() -> None:
    plain = SideOutputs(torch.zeros(2, 1, 4, 4))
    assert plain.sides == () and plain.presence is None


def test_outputs_cannot_be_changed() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        SideOutputs(torch.zeros(2, 1, 4, 4)).logits = torch.ones(2, 1, 4, 4)


def test_outputs_of_unequal_shapes_are_noticed_where_shapes_are_checked() -> None:
    logits = torch.zeros(2, 1, 4, 4)
    for wrong in ((logits[:1],), (torch.zeros(2, 1, 4, 8),)):
        with pytest.raises(Exception, match="sides"):
            SideOutputs(logits, wrong)
    with pytest.raises(Exception, match="presence"):
        SideOutputs(logits, (), torch.zeros(3))
