import pytest
import torch
from torch import nn

from models.errors import InputError
from models.networks.blocks import (
    DoubleConvolution,
    Encoder,
    UpBlock,
    decoder,
    initialise,
    normalisation_layer,
    require_fields,
    require_size,
)


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        ("batch", nn.BatchNorm2d),
        ("instance", nn.InstanceNorm2d),
        ("group", nn.GroupNorm),
        ("none", nn.Identity),
    ],
)
def test_normalisation_layers(kind: str, expected: type) -> None:
    assert isinstance(normalisation_layer(kind, 16), expected)


def test_refuses_an_unknown_normalisation() -> None:
    with pytest.raises(InputError, match=r"normalisation: expected one of batch, .* received 'layer'"):
        normalisation_layer("layer", 16)


def test_convolutions_have_a_bias_only_where_nothing_takes_it_away() -> None:
    with_norm = [m for m in DoubleConvolution(2, 4, "batch", 0.0) if isinstance(m, nn.Conv2d)]
    without = [m for m in DoubleConvolution(2, 4, "none", 0.0) if isinstance(m, nn.Conv2d)]
    assert all(m.bias is None for m in with_norm) and all(m.bias is not None for m in without)


def test_a_bias_can_be_asked_for() -> None:
    block = DoubleConvolution(2, 4, "batch", 0.0, bias=True)
    assert all(module.bias is not None for module in block if isinstance(module, nn.Conv2d))


def test_encoder_halves_the_size_from_level_to_level_and_drops_at_the_two_coarsest() -> None:
    encoder = Encoder([4, 8, 16, 32], "batch", 0.5)
    features = encoder(torch.rand(2, 1, 16, 24))
    assert [tuple(f.shape[1:]) for f in features] == [(4, 16, 24), (8, 8, 12), (16, 4, 6), (32, 2, 3)]
    assert [any(isinstance(m, nn.Dropout2d) for m in level) for level in encoder] == [
        False,
        False,
        True,
        True,
    ]


def test_encoder_passes_on_the_largest_of_four_pixels() -> None:
    encoder = Encoder([1, 1], "none", 0.0)
    with torch.no_grad():
        for parameter in encoder.parameters():
            parameter.zero_()
        for level in encoder:
            level[0].weight[0, 0, 1, 1] = level[3].weight[0, 0, 1, 1] = 1.0
    images = torch.arange(16.0).reshape(1, 1, 4, 4)
    fine, coarse = encoder(images)
    assert torch.equal(fine, images) and coarse.flatten().tolist() == [5, 7, 13, 15]


def test_decoder_goes_from_the_coarsest_level_to_full_size() -> None:
    blocks = decoder([4, 8, 16], "none")
    coarse, skips = torch.rand(1, 16, 2, 3), [torch.rand(1, 8, 4, 6), torch.rand(1, 4, 8, 12)]
    shapes = []
    for block, skip in zip(blocks, skips, strict=True):
        coarse = block(coarse, skip)
        shapes.append(tuple(coarse.shape[1:]))
    assert shapes == [(8, 4, 6), (4, 8, 12)]


def test_dropout_drops_whole_channels_in_training_and_none_in_use() -> None:
    block = DoubleConvolution(1, 64, "batch", 0.5)
    with torch.no_grad():
        images = torch.rand(4, 1, 8, 8)
        dropped = (block(images) == 0).all(dim=(2, 3)).float().mean()
        assert 0.3 < dropped < 0.7
        used = block.eval()(images)
        assert (used == 0).all(dim=(2, 3)).float().mean() < 0.1
        assert torch.equal(used, block(images))


def test_up_block_doubles_the_size_and_uses_both_inputs() -> None:
    block = UpBlock(8, 4, 6, "none", 0.0)
    coarse, skip = torch.rand(2, 8, 5, 7), torch.rand(2, 4, 10, 14)
    result = block(coarse, skip)
    assert result.shape == (2, 6, 10, 14)
    assert not torch.equal(result, block(coarse + 1, skip))
    assert not torch.equal(result, block(coarse, skip + 1))


def test_initialise_follows_the_seed_and_the_fan_in() -> None:
    networks = []
    for seed in (0, 0, 1):
        torch.manual_seed(seed)
        networks.append(nn.Sequential(nn.Conv2d(64, 64, 3)))
        initialise(networks[-1])
    first, same, other = (network[0].weight for network in networks)
    assert torch.equal(first, same) and not torch.equal(first, other)
    assert float(first.std()) == pytest.approx((2 / (64 * 9)) ** 0.5, rel=0.02)
    assert float(networks[0][0].bias.abs().max()) == 0


@pytest.mark.parametrize(("height", "width"), [(32, 32), (48, 160)])
def test_accepts_sizes_that_halve_often_enough(height: int, width: int) -> None:
    require_size(height, width, 16)


@pytest.mark.parametrize(("height", "width"), [(40, 32), (32, 40), (16, 64), (0, 32)])
def test_refuses_other_sizes_with_the_multiple(height: int, width: int) -> None:
    with pytest.raises(InputError, match=rf"multiples of 16, 32 at least, received {height} x {width}"):
        require_size(height, width, 16)


def test_fields_of_a_network_are_checked() -> None:
    fields = {"width": 12, "depth": 3, "normalisation": "batch", "dropout": 0.0}
    require_fields(**fields)
    for wrong, message in (
        ({"width": 0}, "width: expected at least 1 channel, received 0"),
        ({"depth": 8}, "depth: expected 2 to 7 levels, received 8"),
        ({"normalisation": "layer"}, "normalisation: expected one of batch, instance, group, none, received"),
        ({"normalisation": "group"}, "width: expected a multiple of 8 for group normalisation, received 12"),
        ({"dropout": -0.1}, "dropout: expected 0 to below 1, received -0.1"),
    ):
        with pytest.raises(InputError, match=message):
            require_fields(**{**fields, **wrong})
