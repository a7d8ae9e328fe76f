import math

import pytest
import torch

from models.errors import InputError
from models.networks.outputs import SideOutputs, gated
from models.networks.unet3plus import UNet3Plus

SMALL = {"width": 4, "depth": 3, "dropout": 0.0}


def parameters(recipe: UNet3Plus) -> int:
    with torch.device("meta"):
        return sum(parameter.numel() for parameter in recipe().parameters())


def counted_by_hand(width: int, depth: int, *, deep_supervision: bool) -> int:
    """3x3 convolutions with a bias each, and two numbers of batch normalisation for each channel before the head."""
    widths, joined = [width * 2**level for level in range(depth)], depth * width

    def layer(inner: int, outer: int) -> int:
        return 9 * inner * outer + 3 * outer

    total = sum(layer(i, o) + layer(o, o) for i, o in zip([1, *widths], widths, strict=False))
    for level in range(depth - 1):
        sources = [*widths[: level + 1], *[joined] * (depth - level - 2), widths[-1]]
        total += sum(layer(source, width) for source in sources) + layer(joined, joined)
    heads = [joined] + ([joined] * (depth - 2) + [widths[-1]]) * deep_supervision
    return total + sum(9 * channels + 1 for channels in heads)


@pytest.mark.parametrize(("width", "depth"), [(64, 5), (16, 5), (4, 3), (6, 2)])
@pytest.mark.parametrize("deep", [False, True])
def test_parameter_count(width: int, depth: int, deep: bool) -> None:
    recipe = UNet3Plus(width=width, depth=depth, deep_supervision=deep)
    assert parameters(recipe) == counted_by_hand(width, depth, deep_supervision=deep)


@pytest.mark.parametrize(
    ("options", "published"),
    [
        ({}, "26.97"),
        ({"deep_supervision": True}, "26.99"),
        ({"deep_supervision": True, "classification_guided": True}, "26.99"),
    ],
)
def test_published_sizes_to_the_digit(options: dict[str, bool], published: str) -> None:
    assert f"{parameters(UNet3Plus(width=64, **options)) / 1e6:.2f}" == published


@pytest.mark.parametrize("depth", [2, 3, 4, 6])
def test_other_depths_give_logits_of_the_images_size(depth: int) -> None:
    network = UNet3Plus(width=2, depth=depth)()
    size = 2 * UNet3Plus(width=2, depth=depth).multiple
    assert network(torch.rand(2, 1, size, size + size // 2)).shape == (2, 1, size, size + size // 2)


@pytest.mark.parametrize("normalisation", ["batch", "instance", "group", "none"])
def test_every_parameter_learns(normalisation: str) -> None:
    recipe = UNet3Plus(8, 3, normalisation, 0.0, deep_supervision=True)
    network = recipe()
    outputs = network(torch.rand(2, 1, 16, 16))
    torch.stack([outputs.logits, *outputs.sides]).square().mean().backward()
    assert all(parameter.grad is not None for parameter in network.parameters())


def test_a_decoder_level_sees_every_level() -> None:
    network = UNet3Plus(**{**SMALL, "depth": 4}, normalisation="none")()
    sizes = [(4, 32), (8, 16), (16, 8), (32, 4)]
    features = [torch.rand(1, channels, size, size, requires_grad=True) for channels, size in sizes]
    network.decoder[0](features).sum().backward()  # the coarsest, level 2: 8 x 8
    assert all(feature.grad.abs().sum() > 0 for feature in features)
    # The finest map is max-pooled by 4: of each 4 x 4 square, one pixel at most is seen.
    squares = (features[0].grad != 0).unfold(2, 4, 4).unfold(3, 4, 4).sum(dim=(-2, -1))
    assert squares.max() == 1


def test_coarse_features_of_the_decoder_are_enlarged_bilinearly() -> None:
    network = UNet3Plus(**SMALL, normalisation="none")()
    branch = network.decoder[1].branches[2]  # from the bottom, 4 times coarser, to full size
    with torch.no_grad():
        branch.weight.zero_()
        branch.weight[:, 0, 1, 1] = 1.0
        branch.bias.zero_()
    ramp = torch.zeros(1, 16, 2, 2)
    ramp[0, 0] = torch.tensor([[0.0, 8.0], [0.0, 8.0]])
    line = branch(ramp)[0, 0, 3]
    assert line.tolist() == pytest.approx([0, 0, 1, 3, 5, 7, 8, 8])


def test_supervision_is_for_training_alone() -> None:
    torch.manual_seed(0)
    recipe = UNet3Plus(**SMALL, deep_supervision=True, classification_guided=True)
    network, images = recipe(), torch.rand(2, 1, 16, 24)
    outputs = network(images)
    assert isinstance(outputs, SideOutputs)
    assert [side.shape for side in (outputs.logits, *outputs.sides)] == [(2, 1, 16, 24)] * 3
    assert outputs.presence is not None and outputs.presence.shape == (2,)
    used = network.eval()(images)
    assert isinstance(used, torch.Tensor) and used.shape == (2, 1, 16, 24)


@pytest.mark.parametrize(("deep", "guided"), [(False, False), (True, False), (False, True)])
def test_each_option_gives_what_it_names(deep: bool, guided: bool) -> None:
    network = UNet3Plus(**SMALL, deep_supervision=deep, classification_guided=guided)()
    outputs = network(torch.rand(2, 1, 16, 16))
    if not deep and not guided:
        assert isinstance(outputs, torch.Tensor)
        return
    assert isinstance(outputs, SideOutputs)
    assert len(outputs.sides) == (2 if deep else 0) and (outputs.presence is not None) == guided


def test_deep_supervision_does_not_change_what_the_network_says() -> None:
    plain, deep = UNet3Plus(**SMALL)(), UNet3Plus(**SMALL, deep_supervision=True)()
    missing = plain.load_state_dict(deep.state_dict(), strict=False)
    assert not missing.missing_keys and all(key.startswith("sides") for key in missing.unexpected_keys)
    images = torch.rand(2, 1, 16, 16)
    assert torch.equal(plain.eval()(images), deep.eval()(images))


def test_the_gate_multiplies_probabilities() -> None:
    logits = torch.tensor([-3.0, 0.0, 1.5, 4.0]).reshape(1, 1, 2, 2)
    presence = torch.tensor([0.7])
    probability = torch.sigmoid(gated(logits, presence))
    torch.testing.assert_close(probability, torch.sigmoid(logits) * torch.sigmoid(presence))


def test_the_gate_is_stable_where_probabilities_are_not() -> None:
    logits = torch.tensor([-200.0, -200.0, 200.0, 200.0, 3.0])[:, None, None, None]
    presence = torch.tensor([-100.0, 100.0, -100.0, 150.0, 300.0])
    expected = torch.tensor([-300.0, -200.0, -100.0, 150.0, 3.0])
    torch.testing.assert_close(gated(logits, presence).flatten(), expected)
    half = gated(logits.half().requires_grad_(), presence.half())
    half.sum().backward()
    assert half.dtype == torch.float32 and torch.isfinite(half).all()


def test_an_image_without_a_vessel_is_gated_and_its_neighbour_is_not() -> None:
    torch.manual_seed(0)
    network = UNet3Plus(**SMALL, classification_guided=True)().eval()
    images = torch.rand(2, 1, 16, 16)
    with torch.no_grad():
        network.presence[1].weight.zero_()
        network.presence[1].bias.fill_(100.0)
        open_gate = network(images)
        network.presence[1].bias.fill_(-100.0)
        assert network(images).max() < -50
    plain = UNet3Plus(**SMALL)().eval()
    plain.load_state_dict(network.state_dict(), strict=False)
    torch.testing.assert_close(open_gate, plain(images))


def test_the_class_branch_learns_from_presence_and_only_from_it() -> None:
    network = UNet3Plus(**SMALL, deep_supervision=True, classification_guided=True)()
    outputs = network(torch.rand(2, 1, 16, 16))
    branch = network.presence[1]
    torch.stack([outputs.logits, *outputs.sides]).sum().backward(retain_graph=True)
    assert branch.weight.grad is None
    outputs.presence.sum().backward()
    assert branch.weight.grad.abs().max() > 0 and network.encoder[0][0].weight.grad.abs().max() > 0


def test_the_class_branch_finds_a_vessel_wherever_it_is() -> None:
    """Bright squares on some images: after a few steps the branch tells them apart, and the gate follows."""
    torch.manual_seed(0)
    network = UNet3Plus(4, 3, dropout=0.0, classification_guided=True)()
    images, present = 0.05 * torch.rand(8, 1, 16, 16), torch.tensor([1.0, 0.0] * 4)
    for index in (0, 2, 4, 6):
        images[index, 0, index : index + 5, 10 - index : 15 - index] += 1.0
    optimiser = torch.optim.Adam(network.parameters(), lr=0.01)
    for _ in range(40):
        optimiser.zero_grad()
        presence = network(images).presence
        torch.nn.functional.binary_cross_entropy_with_logits(presence, present).backward()
        optimiser.step()
    assert ((network(images).presence > 0) == (present > 0)).all()


def test_an_image_does_not_depend_on_its_batch_in_use_nor_on_the_layout() -> None:
    torch.manual_seed(0)
    network = UNet3Plus(**SMALL, classification_guided=True)().eval()
    images = torch.rand(3, 1, 16, 24)
    together = network(images)
    torch.testing.assert_close(network(images[1:2]), together[1:2])
    network.to(memory_format=torch.channels_last)
    torch.testing.assert_close(network(images.contiguous(memory_format=torch.channels_last)), together)


def test_refuses_sizes_with_the_multiple_it_needs() -> None:
    assert UNet3Plus().multiple == 16
    with pytest.raises(InputError, match="multiples of 4, 8 at least, received 16 x 18"):
        UNet3Plus(width=4, depth=3)()(torch.rand(1, 1, 16, 18))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"width": 0}, "width: expected at least 1 channel, received 0"),
        ({"depth": 1}, "depth: expected 2 to 7 levels, received 1"),
        ({"dropout": 1.0}, "dropout: expected 0 to below 1, received 1.0"),
        ({"normalisation": "group", "width": 4}, "width: expected a multiple of 8 for group .* received 4"),
    ],
)
def test_refuses_settings(settings: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        UNet3Plus(**settings)


def test_gate_of_even_odds() -> None:
    # Two coins: 1/4 against 3/4.
    logit = gated(torch.zeros(1, 1, 1, 1), torch.zeros(1))
    assert float(logit) == pytest.approx(math.log(1 / 3))
