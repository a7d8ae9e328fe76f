import numpy as np
import pytest
import torch
from torch import Tensor

from models.averaging import (
    BatchEvaluation,
    Member,
    WeightMatching,
    align_all,
    channel_ties,
    interpolation_barriers,
    permuted,
)
from models.averaging.channel_ties import ChannelTies
from models.errors import InputError
from models.networks.attention_unet import AttentionUNet
from models.networks.registry import NetworkRecipe
from models.networks.unet import UNet
from models.networks.unet3plus import UNet3Plus
from models.training.losses import DiceCrossEntropy

RECIPES = {
    "unet": UNet(8, 3),
    "attention_unet": AttentionUNet(6, 3),
    "unet3plus": UNet3Plus(4, 3, "instance"),
}
every_recipe = pytest.mark.parametrize("recipe", RECIPES.values(), ids=RECIPES)


def drawn(recipe: NetworkRecipe, seed: int) -> dict[str, Tensor]:
    torch.manual_seed(seed)
    return {name: tensor.clone() for name, tensor in recipe().state_dict().items()}


def shuffle(weights: dict[str, Tensor], ties: ChannelTies, seed: int) -> dict[str, Tensor]:
    generator = np.random.default_rng(seed)
    return permuted(weights, ties, {group: generator.permutation(ties.size(group)) for group in ties.movable})


@every_recipe
def test_a_shuffled_network_is_put_in_order_again(recipe: NetworkRecipe) -> None:
    ties, weights = channel_ties(recipe), drawn(recipe, 0)
    found = WeightMatching()(weights, shuffle(weights, ties, 1), ties)
    assert all(torch.equal(found.weights[name], tensor) for name, tensor in weights.items())
    assert found.moved_channels > 0 and found.agreement_after > found.agreement_before


@every_recipe
def test_an_aligned_network_computes_what_it_did(recipe: NetworkRecipe) -> None:
    ties, reference, moving = channel_ties(recipe), drawn(recipe, 0), drawn(recipe, 1)
    found = WeightMatching()(reference, moving, ties)
    # Networks of different starts gain agreement, and the agreement reported is that of the weights returned.
    assert found.agreement_after > found.agreement_before + 1
    inner = sum(
        float((reference[name].double() * found.weights[name].double()).sum()) for name in ties.parameters
    )
    assert inner == pytest.approx(found.agreement_after, rel=1e-6)
    network, images = recipe().eval(), torch.rand(2, 1, 16, 16)
    outputs = []
    for weights in (moving, found.weights):
        network.load_state_dict(weights)
        outputs.append(network(images))
    torch.testing.assert_close(outputs[0], outputs[1], rtol=1e-4, atol=1e-4)


def test_networks_in_order_stay_as_they_are() -> None:
    recipe = RECIPES["unet"]
    ties, weights = channel_ties(recipe), drawn(recipe, 0)
    close = {n: t + 1e-3 * torch.randn_like(t) if n in ties.parameters else t for n, t in weights.items()}
    found = WeightMatching()(weights, close, ties)
    assert found.moved_channels == 0 and found.sweeps == 1
    assert found.agreement_after == found.agreement_before


def test_one_hidden_layer_has_the_best_of_all_orders() -> None:
    # Of a single double convolution's inner channels all 24 orders can be tried.
    from itertools import permutations

    ties = channel_ties(UNet(4, 2))
    reference, moving = drawn(UNet(4, 2), 0), drawn(UNet(4, 2), 1)
    group = ties.axes["encoder.0.0.weight"][0][0]
    frozen = {g: labels if g == group else np.arange(len(labels)) for g, labels in ties.blocks.items()}
    found = WeightMatching()(reference, moving, ChannelTies(frozen, ties.axes, ties.parameters))

    def agreement(order: tuple[int, ...]) -> float:
        weights = permuted(moving, ties, {group: np.array(order)})
        return sum(
            float((reference[name].double() * weights[name].double()).sum()) for name in ties.parameters
        )

    best = max(permutations(range(4)), key=agreement)
    assert found.permutations[group].tolist() == list(best)
    assert found.agreement_after == pytest.approx(agreement(best))


def test_the_result_is_the_same_each_time() -> None:
    recipe = RECIPES["unet"]
    ties = channel_ties(recipe)
    results = [WeightMatching(seed=2)(drawn(recipe, 0), drawn(recipe, 1), ties) for _ in range(2)]
    assert all(torch.equal(results[0].weights[name], results[1].weights[name]) for name in results[0].weights)


def test_many_shuffled_networks_come_to_one_order() -> None:
    recipe = RECIPES["unet"]
    ties, weights = channel_ties(recipe), drawn(recipe, 0)
    noisy = [
        {n: t + 1e-3 * torch.randn_like(t) if t.ndim > 1 else t for n, t in weights.items()} for _ in range(3)
    ]
    aligned = align_all([shuffle(each, ties, i) for i, each in enumerate(noisy)], ties, WeightMatching())
    for other in aligned[1:]:
        assert all(torch.allclose(aligned[0][n], other[n], atol=2e-2) for n in ties.parameters)
    with pytest.raises(InputError, match="expected at least two networks"):
        align_all([weights], ties, WeightMatching())


def test_refuses_other_weights_and_no_sweeps() -> None:
    recipe = RECIPES["unet"]
    ties, weights = channel_ties(recipe), drawn(recipe, 0)
    with pytest.raises(InputError, match="weights of the network to align: expected"):
        WeightMatching()(weights, drawn(UNet(4, 3), 0), ties)
    with pytest.raises(InputError, match="expected those of the network that was followed"):
        WeightMatching()({"a": torch.ones(1)}, {"a": torch.ones(1)}, ties)
    with pytest.raises(InputError, match="max_sweeps: expected at least 1"):
        WeightMatching(max_sweeps=0)


def discs(seed: int, n: int) -> tuple[Tensor, Tensor]:
    """Dark discs in noise, and their masks."""
    generator = np.random.default_rng(seed)
    rows, columns = np.indices((16, 16))
    radii, centres = generator.uniform(2, 5, n), generator.uniform(5, 11, (n, 2))
    masks = np.stack([np.hypot(rows - c[0], columns - c[1]) < r for r, c in zip(radii, centres, strict=True)])
    images = np.where(masks, 0.25, 0.6) + 0.15 * generator.standard_normal(masks.shape)
    return torch.from_numpy(images).float()[:, None], torch.from_numpy(masks).float()[:, None]


def trained(recipe: NetworkRecipe, start: int, fold: int) -> dict[str, Tensor]:
    torch.manual_seed(start)
    network, loss = recipe().train(), DiceCrossEntropy()
    images, masks = discs(fold, 32)
    optimiser = torch.optim.AdamW(network.parameters(), lr=5e-3)
    generator = torch.Generator().manual_seed(fold)
    for _ in range(60):
        drawn_images = torch.randperm(len(images), generator=generator)[:8]
        optimiser.zero_grad()
        loss(network(images[drawn_images]), masks[drawn_images]).backward()
        optimiser.step()
    return {name: tensor.clone() for name, tensor in network.state_dict().items()}


def test_a_barrier_between_starts_is_lowered_by_alignment_and_there_is_none_from_one_start() -> None:
    recipe = UNet(8, 3, dropout=0.0)
    first, sibling, stranger = (trained(recipe, start, fold) for start, fold in ((0, 1), (0, 2), (5, 3)))
    aligned = WeightMatching()(first, stranger, channel_ties(recipe)).weights
    images, masks = discs(9, 24)
    evaluate = BatchEvaluation(recipe(), DiceCrossEntropy(), lambda: [(images, masks)], lambda: [images])

    def barrier(other: dict[str, Tensor]) -> float:
        pair = [Member("first", recipe, first), Member("other", recipe, other)]
        return interpolation_barriers(pair, evaluate, n_points=5).paths[0].loss_barrier

    assert evaluate(first).dsc > 0.85 and evaluate(stranger).dsc > 0.85
    before, after = barrier(stranger), barrier(aligned)
    assert before > 0.2 and after < 0.5 * before and barrier(sibling) < 0.1 * before
