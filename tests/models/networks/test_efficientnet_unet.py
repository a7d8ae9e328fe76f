import pytest
import torch

from models.errors import InputError
from models.networks.efficientnet_unet import (
    BLOCKS,
    EfficientNetUNet,
    FixedNormalisation,
    InvertedBottleneck,
)


def test_the_encoder_has_the_published_size() -> None:
    # 4 652 008 weights as published, less the head, and less the two colours that a grey image has not.
    network, head = EfficientNetUNet()(), 320 * 1280 + 2 * 1280 + 1281 * 1000
    assert sum(p.numel() for p in network.encoder.parameters()) == 4_652_008 - head - 2 * 32 * 9
    assert len(network.encoder.blocks) == len(BLOCKS) == 16


def test_features_and_logits_have_their_sizes() -> None:
    network = EfficientNetUNet(width=4)().eval()
    images = torch.rand(2, 1, 64, 96)
    sizes = [tuple(feature.shape[1:]) for feature in network.encoder(images)]
    assert sizes == [(1, 64, 96), (16, 32, 48), (24, 16, 24), (40, 8, 12), (112, 4, 6), (320, 2, 3)]
    assert network(images).shape == (2, 1, 64, 96)
    with pytest.raises(InputError, match="multiples of 32"):
        network(torch.rand(1, 1, 64, 80))


def test_statistics_are_fixed_and_scale_and_shift_are_trained() -> None:
    layer = FixedNormalisation(1).train()
    layer.running_mean.fill_(3.0)
    layer.running_var.fill_(4.0 - 1e-3)
    with torch.no_grad():
        layer.weight.fill_(2.0)
        layer.bias.fill_(1.0)
    found = layer(torch.full((1, 1, 2, 2), 7.0))
    torch.testing.assert_close(found, torch.full((1, 1, 2, 2), 2.0 * (7 - 3) / 2 + 1))
    assert float(layer.running_mean) == 3.0 and layer.weight.requires_grad


@pytest.mark.parametrize(
    ("stride", "first"), [(1, 1.0 + 2 + 4 + 5), (2, 1.0 + 2 + 3 + 4 + 5 + 6 + 7 + 8 + 9)]
)
def test_strided_convolutions_are_padded_at_the_far_side(stride: int, first: float) -> None:
    block = InvertedBottleneck(1, 3, stride, 1, 2)
    with torch.no_grad():
        block.depthwise[0].weight.fill_(1.0)
        block.project[0].weight.fill_(1.0)
    block.depthwise[2] = torch.nn.Identity()
    image = torch.tensor([[1.0, 2, 3, 0], [4, 5, 6, 0], [7, 8, 9, 0], [0, 0, 0, 0]])[None, None]
    found = block(image)
    assert found.shape[-1] == 4 // stride
    # Normalisation by a deviation of 1 and the published epsilon of 0.001, twice.
    assert float(found[0, 0, 0, 0]) == pytest.approx(first / 1.001, rel=1e-5)


def test_refuses_settings_by_name() -> None:
    for wrong, message in (
        ({"width": 0}, "width: expected at least 1"),
        ({"normalisation": "layer"}, "normalisation: expected one of"),
        ({"dropout": 1.0}, "dropout: expected 0 to below 1"),
    ):
        with pytest.raises(InputError, match=message):
            EfficientNetUNet(**wrong)
