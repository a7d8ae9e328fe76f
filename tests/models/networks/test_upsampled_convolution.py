import pytest
import torch
from torch import nn
from torch.nn import functional

from models.networks.upsampled_convolution import UpsampledConvolution


def enlarged_then_convolved(features: torch.Tensor, layer: UpsampledConvolution) -> torch.Tensor:
    enlarged = functional.interpolate(features, scale_factor=float(layer.scale), mode="bilinear")
    return functional.conv2d(enlarged, layer.weight, layer.bias, padding=1)


@pytest.mark.parametrize("scale", [2, 4, 8, 16])
@pytest.mark.parametrize("layout", [torch.contiguous_format, torch.channels_last])
def test_equals_enlarging_and_then_convolving(scale: int, layout: torch.memory_format) -> None:
    torch.manual_seed(scale)
    layer = UpsampledConvolution(5, 3, scale=scale).double()
    features = torch.randn(2, 5, 3, 4, dtype=torch.float64).contiguous(memory_format=layout).requires_grad_()
    weights = torch.randn(2, 3, 3 * scale, 4 * scale, dtype=torch.float64)
    results = []
    for result in (layer(features), enlarged_then_convolved(features, layer)):
        (result * weights).sum().backward()
        gradients = [features.grad, layer.weight.grad, layer.bias.grad]
        results.append([result, *(gradient.clone() for gradient in gradients)])
        for gradient in gradients:
            gradient.zero_()
    for fast, direct in zip(*results, strict=True):
        torch.testing.assert_close(fast, direct, rtol=1e-12, atol=1e-12)


def test_one_pixel_of_one_channel_by_hand() -> None:
    layer = UpsampledConvolution(1, 1, scale=4)
    with torch.no_grad():
        layer.weight.fill_(1.0)
        layer.bias.fill_(2.0)
    # A single value fills the enlarged 4 x 4 square; a corner has four neighbours inside, a side six, the middle nine.
    expected = torch.tensor([[4.0, 6, 6, 4], [6, 9, 9, 6], [6, 9, 9, 6], [4, 6, 6, 4]])
    torch.testing.assert_close(layer(torch.ones(1, 1, 1, 1))[0, 0], expected + 2)


def test_has_the_weights_of_a_plain_convolution() -> None:
    layer = UpsampledConvolution(5, 3, scale=8)
    layer.load_state_dict(nn.Conv2d(5, 3, 3, padding=1).state_dict())


def test_half_precision_is_as_exact_as_its_numbers() -> None:
    torch.manual_seed(0)
    layer = UpsampledConvolution(4, 2, scale=8)
    features = torch.rand(1, 4, 4, 4)
    expected = layer(features)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        result = layer(features)
    torch.testing.assert_close(result.float(), expected, rtol=0.02, atol=0.02)
