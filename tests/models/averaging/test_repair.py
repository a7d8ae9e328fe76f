from collections.abc import Iterator

import pytest
import torch
from torch import Tensor, nn

from models.averaging import repair
from models.averaging.batch_statistics import PooledStatistics
from models.averaging.members import combination
from models.errors import InputError
from models.networks.attention_unet import AttentionUNet
from models.networks.unet import UNet


def batches() -> Iterator[Tensor]:
    generator = torch.Generator().manual_seed(5)
    yield from torch.rand(12, 1, 16, 16, generator=generator).split(4)


def drawn(recipe: UNet | AttentionUNet, n: int) -> list[dict[str, Tensor]]:
    found = []
    for seed in range(n):
        torch.manual_seed(seed)
        network = recipe()
        with torch.no_grad():
            for module in network.modules():
                if isinstance(module, (nn.Conv2d, nn.ConvTranspose2d)) and module.bias is not None:
                    module.bias.normal_()
        found.append({name: tensor.clone() for name, tensor in network.state_dict().items()})
    return found


def first_statistics(network: nn.Module, weights: dict[str, Tensor]) -> PooledStatistics:
    network.load_state_dict(weights)
    pooled = PooledStatistics()
    with torch.no_grad():
        for batch in batches():
            pooled.update(network.encoder[0][0](batch))
    return pooled


def test_a_first_layer_gets_the_mean_of_means_and_of_deviations() -> None:
    recipe = UNet(6, 3, "none")
    members, network = drawn(recipe, 3), recipe()
    average = combination(members, [1 / 3] * 3)
    of_members = [first_statistics(network, each) for each in members]
    goal_mean = sum(each.mean for each in of_members) / 3
    goal_deviation = sum(each.variance(0).sqrt() for each in of_members) / 3
    lost = first_statistics(network, average).variance(0).sqrt()
    assert float((lost / goal_deviation).mean()) < 0.9  # the variance that averaging loses
    repaired = first_statistics(network, repair(network, average, members, batches))
    torch.testing.assert_close(repaired.mean, goal_mean, rtol=1e-3, atol=1e-4)
    torch.testing.assert_close(repaired.variance(0).sqrt(), goal_deviation, rtol=1e-2, atol=1e-4)


@pytest.mark.parametrize("recipe", [UNet(6, 3, "none"), AttentionUNet(6, 3, "none")])
def test_a_network_alone_needs_no_repair(recipe: UNet | AttentionUNet) -> None:
    (member,) = drawn(recipe, 1)
    network = recipe()
    # One batch: its statistics are those of the whole.
    images = next(batches())
    repaired = repair(network, member, [member], lambda: [images])
    outputs = []
    for weights in (member, repaired):
        network.load_state_dict(weights)
        outputs.append(network.eval()(images))
    torch.testing.assert_close(outputs[0], outputs[1], rtol=2e-2, atol=2e-2)


def test_with_batch_normalisation_the_statistics_are_re_estimated() -> None:
    recipe = UNet(6, 3)
    members, network, peer = drawn(recipe, 2), recipe(), recipe()
    average = combination(members, [0.5, 0.5])
    repaired = repair(network, average, members, batches)
    from models.averaging import reestimate_batch_statistics

    peer.load_state_dict(average)
    reestimate_batch_statistics(peer, batches())
    assert all(torch.equal(repaired[name], tensor) for name, tensor in peer.state_dict().items())
    assert not network.training


def test_hooks_are_gone_and_no_members_or_images_are_refused() -> None:
    recipe = UNet(4, 2, "none")
    (member,), network = drawn(recipe, 1), recipe()
    repair(network, member, [member], batches)
    assert not any(module._forward_hooks for module in network.modules())
    with pytest.raises(InputError, match="members: expected the networks of the average"):
        repair(network, member, [], batches)
    with pytest.raises(InputError, match="batches: expected at least one"):
        repair(network, member, [member], lambda: [])
