import pytest
import torch
from torch import Tensor, nn

from models.averaging import reestimate_batch_statistics
from models.averaging.batch_statistics import PooledStatistics
from models.errors import InputError
from models.networks.attention_unet import AttentionUNet
from models.networks.unet import UNet
from models.networks.unet3plus import UNet3Plus


def images(n: int, size: int = 16) -> Tensor:
    # Every image has a brightness and a contrast of its own, so that batches differ.
    generator = torch.Generator().manual_seed(3)
    noise = torch.randn(n, 1, size, size, generator=generator)
    return noise * torch.rand(n, 1, 1, 1, generator=generator) + 4 * torch.rand(
        n, 1, 1, 1, generator=generator
    )


def buffers(network: nn.Module) -> dict[str, Tensor]:
    return {name: buffer.clone() for name, buffer in network.named_buffers()}


def assert_same(one: dict[str, Tensor], other: dict[str, Tensor], tolerance: float = 1e-5) -> None:
    assert one.keys() == other.keys() and one
    for name in one:
        torch.testing.assert_close(one[name], other[name], rtol=tolerance, atol=tolerance, msg=name)


def test_pooled_statistics_are_those_of_all_values_however_they_come() -> None:
    values = images(10)
    pooled = PooledStatistics()
    for part in (values[:1], values[1:7], values[7:]):
        pooled.update(part)
    assert float(pooled.mean) == pytest.approx(float(values.double().mean()), rel=1e-6)
    assert float(pooled.variance(1)) == pytest.approx(float(values.double().var()), rel=1e-6)


def test_one_batch_gives_what_torch_gives() -> None:
    torch.manual_seed(0)
    ours, peer = UNet(width=4, depth=3, dropout=0.0)(), UNet(width=4, depth=3, dropout=0.0)()
    peer.load_state_dict(ours.state_dict())
    assert reestimate_batch_statistics(ours, [images(6)]) == 6
    torch.optim.swa_utils.update_bn([images(6)], peer)
    assert_same(buffers(ours), buffers(peer))


def test_the_order_of_the_batches_does_not_matter() -> None:
    torch.manual_seed(0)
    network = UNet3Plus(width=4, depth=3, classification_guided=True)()
    batches = list(images(9).split(4))
    assert reestimate_batch_statistics(network, iter(batches)) == 9
    first = buffers(network)
    reestimate_batch_statistics(network, reversed(batches))
    assert_same(first, buffers(network))


def test_batches_of_any_size_give_the_first_layer_the_same_statistics() -> None:
    torch.manual_seed(0)
    network = nn.Sequential(nn.Conv2d(1, 3, 3), nn.BatchNorm2d(3))
    reestimate_batch_statistics(network, images(12).split(12))
    whole = buffers(network)
    reestimate_batch_statistics(network, images(12).split(5))
    parts = buffers(network)
    assert int(whole.pop("1.num_batches_tracked")) == 1 and int(parts.pop("1.num_batches_tracked")) == 3
    assert_same(whole, parts)


def test_a_layer_in_use_normalises_what_it_was_estimated_on() -> None:
    torch.manual_seed(0)
    network = nn.Sequential(nn.Conv2d(1, 3, 3), nn.BatchNorm2d(3, affine=False)).eval()
    reestimate_batch_statistics(network, images(12).split(5))
    normalised = network(images(12))
    torch.testing.assert_close(normalised.mean(dim=(0, 2, 3)), torch.zeros(3), atol=1e-5, rtol=0)
    torch.testing.assert_close(normalised.std(dim=(0, 2, 3)), torch.ones(3), atol=1e-4, rtol=0)


def test_modes_weights_and_random_numbers_are_left_alone() -> None:
    torch.manual_seed(0)
    network = AttentionUNet(width=4, depth=3, dropout=0.5)()
    network.encoder.eval()
    modes = [module.training for module in network.modules()]
    weights = {name: parameter.clone() for name, parameter in network.named_parameters()}
    state = torch.get_rng_state()
    reestimate_batch_statistics(network, [images(4)])
    assert [module.training for module in network.modules()] == modes
    assert all(torch.equal(parameter, weights[name]) for name, parameter in network.named_parameters())
    assert torch.equal(torch.get_rng_state(), state)
    layers = [module for module in network.modules() if isinstance(module, nn.BatchNorm2d)]
    assert all(layer.track_running_stats and not layer._forward_pre_hooks for layer in layers)


@pytest.mark.parametrize("normalisation", ["instance", "group", "none"])
def test_without_batch_normalisation_nothing_is_read(normalisation: str) -> None:
    network = UNet(width=8, depth=2, normalisation=normalisation)()
    unread = iter([images(2)])
    assert reestimate_batch_statistics(network, unread) == 0
    assert len(next(unread)) == 2


def test_a_failure_changes_nothing() -> None:
    network = UNet(width=4, depth=2)()
    before = buffers(network)
    with pytest.raises(InputError, match="batches: expected at least one"):
        reestimate_batch_statistics(network, [])
    with pytest.raises(InputError, match="image size"):
        reestimate_batch_statistics(network, [images(2), images(2, size=7)])
    assert_same(before, buffers(network), 0.0)
    with pytest.raises(InputError, match="1: expected an instance normalisation without tracked statistics"):
        reestimate_batch_statistics(
            nn.Sequential(nn.Conv2d(1, 2, 3), nn.InstanceNorm2d(2, track_running_stats=True)), [images(2)]
        )
