import pytest
import torch

from models.errors import InputError
from models.networks.unet import UNet


def parameters(recipe: UNet) -> int:
    return sum(parameter.numel() for parameter in recipe().parameters())


def counted_by_hand(width: int, depth: int) -> int:
    """Weights and biases of 3x3 convolutions in pairs, of 2x2 up-convolutions, and of the last 1x1 one."""
    widths = [width * 2**level for level in range(depth)]

    def pair(inner: int, outer: int) -> int:
        return 9 * inner * outer + outer + 9 * outer * outer + outer

    down = sum(pair(inner, outer) for inner, outer in zip([1, *widths], widths, strict=False))
    up = sum(4 * 2 * w * w + w + pair(2 * w, w) for w in widths[:-1])
    return down + up + width + 1


@pytest.mark.parametrize(("width", "depth"), [(64, 5), (16, 5), (4, 3)])
def test_parameter_count(width: int, depth: int) -> None:
    assert parameters(UNet(width=width, depth=depth, normalisation="none")) == counted_by_hand(width, depth)


def test_published_size_has_31_million_parameters() -> None:
    assert parameters(UNet()) == pytest.approx(31.03e6, rel=1e-3)


@pytest.mark.parametrize("normalisation", ["batch", "instance", "group", "none"])
def test_logits_have_the_images_size(normalisation: str) -> None:
    network = UNet(width=4, depth=3, normalisation=normalisation)()
    assert network(torch.rand(2, 1, 16, 24)).shape == (2, 1, 16, 24)


def test_a_pixel_reaches_every_output_within_the_field_of_view() -> None:
    torch.manual_seed(0)
    network = UNet(width=4, depth=3, normalisation="none", dropout=0.0)()
    images = torch.rand(1, 1, 32, 32, requires_grad=True)
    network(images)[0, 0, 16, 16].backward()
    reached = images.grad[0, 0] != 0
    # Two 3x3 convolutions at strides 1, 2 and 4 and back see 18 px and more to each side; a plain chain of the
    # eight convolutions at full size would see 8.
    assert reached[16, 16 - 14 : 16 + 14].all() and reached[16 - 14 : 16 + 14, 16].all()


def test_seed_decides_the_weights() -> None:
    weights = []
    for seed in (0, 0, 1):
        torch.manual_seed(seed)
        weights.append(UNet(width=4, depth=2)().state_dict()["encoder.0.0.weight"])
    assert torch.equal(weights[0], weights[1]) and not torch.equal(weights[0], weights[2])


def test_every_parameter_learns() -> None:
    network = UNet(width=4, depth=3, dropout=0.0)()
    network(torch.rand(2, 1, 16, 16)).square().mean().backward()
    assert all(parameter.grad is not None for parameter in network.parameters())


def test_refuses_sizes_with_the_multiple_it_needs() -> None:
    assert UNet().multiple == 16
    with pytest.raises(InputError, match="multiples of 4, 8 at least, received 16 x 18"):
        UNet(width=4, depth=3)()(torch.rand(1, 1, 16, 18))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"width": 0}, "width: expected at least 1 channel, received 0"),
        ({"depth": 1}, "depth: expected 2 to 7 levels, received 1"),
        ({"normalisation": "layer"}, "normalisation: expected one of"),
        ({"normalisation": "group", "width": 12}, "width: expected a multiple of 8"),
        ({"dropout": 1.0}, "dropout: expected 0 to below 1, received 1.0"),
    ],
)
def test_refuses_settings(settings: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        UNet(**settings)
