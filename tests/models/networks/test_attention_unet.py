import pytest
import torch

from models.errors import InputError
from models.networks.attention_unet import AttentionGate, AttentionUNet
from models.networks.unet import UNet


def parameters(recipe) -> int:
    return sum(parameter.numel() for parameter in recipe().parameters())


def gate_counted_by_hand(skip: int, gating: int) -> int:
    """2x2 convolution without bias; 1x1 with, from the gating signal; 1x1 to one channel; the 1x1 projection."""
    return 4 * skip * skip + gating * skip + skip + skip + 1 + skip * skip + skip


@pytest.mark.parametrize(
    ("depth", "levels", "gated"), [(5, None, [1, 2, 3]), (4, None, [1, 2]), (4, [0, 2], [0, 2]), (3, [], [])]
)
def test_a_unet_with_gates_on_the_chosen_skips(depth: int, levels, gated: list[int]) -> None:
    shape = {"width": 4, "depth": depth, "normalisation": "none"}
    gates = sum(gate_counted_by_hand(4 * 2**level, 8 * 2**level) for level in gated)
    recipe = AttentionUNet(**shape, gated_levels=levels)
    assert parameters(recipe) == parameters(UNet(**shape)) + gates
    assert [int(level) for level in recipe().gates] == gated


def test_parameters_at_width_64() -> None:
    gates = sum(gate_counted_by_hand(skip, 2 * skip) for skip in (128, 256, 512))
    with torch.device("meta"):
        assert parameters(AttentionUNet(normalisation="none")) == 31_030_593 + gates == 33_441_732


def a_gate() -> AttentionGate:
    """One channel; the skip's upper left pixel of four counts on the coarse grid, and so does the gating signal."""
    gate = AttentionGate(1, 1, "none")
    with torch.no_grad():
        gate.skip.weight.copy_(torch.tensor([[1.0, 0.0], [0.0, 0.0]]))
        gate.gating.weight.fill_(2.0)
        gate.gating.bias.fill_(-1.0)
        gate.psi.weight.fill_(3.0)
        gate.psi.bias.fill_(-6.0)
        gate.projection[0].weight.fill_(10.0)
        gate.projection[0].bias.fill_(0.5)
    return gate


def test_a_gate_is_the_papers_formula() -> None:
    skip = torch.tensor([[1.0, 5.0, 0.0, 5.0], [5.0, 5.0, 5.0, 5.0]]).reshape(1, 1, 2, 4)
    gating = torch.tensor([1.0, 0.0]).reshape(1, 1, 1, 2)
    # Left: relu(1 + 2 - 1) = 2, so 3 * 2 - 6 = 0; right: relu(0 + 0 - 1) = 0, so -6. Between them, a quarter and
    # three quarters of the way.
    left, right = 0.5, float(torch.sigmoid(torch.tensor(-6.0)))
    line = [left, 0.75 * left + 0.25 * right, 0.25 * left + 0.75 * right, right]
    attention = torch.tensor([line, line]).reshape(1, 1, 2, 4)
    torch.testing.assert_close(a_gate().attention(skip, gating), attention)
    torch.testing.assert_close(a_gate()(skip, gating), 10 * skip * attention + 0.5)


def test_a_closed_gate_lets_nothing_of_the_skip_through() -> None:
    gate = AttentionGate(4, 8, "batch").eval()
    skip, gating = torch.rand(1, 4, 8, 8), torch.rand(1, 8, 4, 4)
    assert not torch.allclose(gate(skip, gating), gate(skip + 1, gating))
    torch.nn.init.constant_(gate.psi.weight, 0.0)
    torch.nn.init.constant_(gate.psi.bias, -1000.0)
    assert torch.equal(gate(skip, gating), gate(skip + 1, gating))


def test_closed_gates_leave_what_passes_through_the_bottom_and_the_open_skip() -> None:
    torch.manual_seed(0)
    network = AttentionUNet(width=4, depth=3)().eval()
    images = torch.rand(1, 1, 16, 16)
    before = network(images)
    for gate in network.gates.values():
        torch.nn.init.constant_(gate.psi.bias, -1000.0)
    closed = network(images)
    assert not torch.allclose(before, closed)
    # With the gates closed, what the gated skip's level makes of the image no longer matters to the gate's output.
    torch.nn.init.zeros_(network.gates["1"].skip.weight)
    assert torch.equal(network(images), closed)


def test_a_gate_is_fed_by_the_decoder_of_the_next_coarser_level() -> None:
    network = AttentionUNet(width=4, depth=4)().eval()
    fed = {}
    for level, gate in network.gates.items():
        gate.register_forward_hook(lambda _, given, __, level=level: fed.update({level: given[1].shape[1:]}))
    ups = []
    for up in network.decoder:
        up.register_forward_hook(lambda _, __, result: ups.append(result.shape[1:]))
    network(torch.rand(1, 1, 32, 32))
    # Level 2 is gated by the bottom (32 channels at 4 x 4), level 1 by the decoder's level 2.
    assert fed == {"2": (32, 4, 4), "1": ups[0]} and ups[0] == (16, 8, 8)


@pytest.mark.parametrize("normalisation", ["batch", "instance", "group", "none"])
def test_logits_have_the_images_size_and_every_parameter_learns(normalisation: str) -> None:
    network = AttentionUNet(width=4, depth=3, normalisation=normalisation, dropout=0.0)()
    logits = network(torch.rand(2, 1, 16, 24))
    assert logits.shape == (2, 1, 16, 24)
    logits.square().mean().backward()
    assert all(parameter.grad is not None for parameter in network.parameters())
    assert all(parameter.grad.abs().max() > 0 for parameter in network.gates.parameters())


def test_refuses_sizes_with_the_multiple_it_needs() -> None:
    assert AttentionUNet().multiple == 16
    with pytest.raises(InputError, match="multiples of 4, 8 at least, received 16 x 18"):
        AttentionUNet(width=4, depth=3)()(torch.rand(1, 1, 16, 18))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"width": 0}, "width: expected at least 1 channel, received 0"),
        ({"normalisation": "layer"}, "normalisation: expected one of"),
        ({"depth": 2}, "depth: expected at least 3 levels where gated_levels is not given, received 2"),
        ({"gated_levels": [4]}, r"gated_levels: expected different levels of 0 to 3, received \[4\]"),
        ({"gated_levels": (1, 1)}, r"gated_levels: expected different levels of 0 to 3, received \[1, 1\]"),
    ],
)
def test_refuses_settings(settings: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        AttentionUNet(**settings)
