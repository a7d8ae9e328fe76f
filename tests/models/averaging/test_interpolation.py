import numpy as np
import pytest
import torch
from torch import Tensor, nn

from models.averaging import BatchEvaluation, Evaluation, Member, Weights, interpolation_barriers
from models.errors import InputError
from models.networks.unet import UNet
from models.training.losses import DiceCrossEntropy

RECIPE = UNet(width=2, depth=2)


def at(name: str, value: float) -> Member:
    return Member(name, RECIPE, {"a": torch.tensor(value, dtype=torch.float64)}, name)


def double_well(weights: Weights) -> Evaluation:
    """Minima at -1 and 1, and a hill of height 1 between them."""
    a = float(weights["a"])
    return Evaluation((a**2 - 1) ** 2, 1 - 0.5 * abs(abs(a) - 1))


def test_the_barrier_of_a_double_well_is_its_hill() -> None:
    found = interpolation_barriers([at("x", -1.0), at("y", 1.0)], double_well, n_points=5)
    (path,) = found.paths
    np.testing.assert_allclose(path.alphas, [0, 0.25, 0.5, 0.75, 1])
    np.testing.assert_allclose(path.losses, [0, 0.5625, 1, 0.5625, 0])
    np.testing.assert_allclose(path.dscs, [1, 0.75, 0.5, 0.75, 1])
    assert path.loss_barrier == pytest.approx(1.0) and path.dsc_barrier == pytest.approx(0.5)
    np.testing.assert_allclose(found.loss, [[0, 1], [1, 0]])
    np.testing.assert_allclose(found.dsc, [[0, 0.5], [0.5, 0]])


def test_the_barrier_is_taken_against_the_line_between_unequal_ends() -> None:
    found = interpolation_barriers([at("x", 1.0), at("y", 2.0)], double_well, n_points=3)
    # At 1.5 the loss is 1.5625, below the mean of 0 and 9: a convex stretch has no barrier.
    assert found.paths[0].loss_barrier == 0.0


def test_every_network_is_evaluated_once_and_every_pair_has_a_path() -> None:
    calls: list[float] = []

    def counted(weights: Weights) -> Evaluation:
        calls.append(float(weights["a"]))
        return double_well(weights)

    found = interpolation_barriers([at("x", -1.0), at("y", 1.0), at("z", 3.0)], counted, n_points=3)
    assert [(path.first, path.second) for path in found.paths] == [("x", "y"), ("x", "z"), ("y", "z")]
    assert calls == [-1.0, 1.0, 3.0, 0.0, 1.0, 2.0]
    assert found.loss[0, 1] == found.loss[1, 0] == pytest.approx(1.0)


def test_refuses_single_networks_few_points_and_undefined_values() -> None:
    pair = [at("x", -1.0), at("y", 1.0)]
    with pytest.raises(InputError, match="members: expected at least two"):
        interpolation_barriers(pair[:1], double_well)
    with pytest.raises(InputError, match="n_points: expected at least 3"):
        interpolation_barriers(pair, double_well, n_points=2)
    with pytest.raises(InputError, match=r"evaluation of x to y at 0\.5"):
        interpolation_barriers(
            pair,
            lambda weights: Evaluation(float("nan") if float(weights["a"]) == 0 else 0.0, 1.0),
            n_points=3,
        )


def batches(masks: Tensor) -> list[tuple[Tensor, Tensor]]:
    images = torch.rand(len(masks), 1, 8, 8, generator=torch.Generator().manual_seed(0))
    return list(zip(images.split(2), masks.split(2), strict=True))


def test_an_evaluation_by_hand() -> None:
    network = nn.Conv2d(1, 1, 1)
    masks = torch.zeros(3, 1, 8, 8)
    masks[0, :, :4] = 1
    masks[1] = 1
    evaluate = BatchEvaluation(network, DiceCrossEntropy(dice_weight=0.0), lambda: batches(masks))
    # All pixels are vessel, with a logit of 2: DSC 2/3 and 1; the third image has no vessel and counts in the loss.
    found = evaluate({"weight": torch.zeros(1, 1, 1, 1), "bias": torch.tensor([2.0])})
    assert found.dsc == pytest.approx((2 / 3 + 1) / 2)
    missing, false = np.log1p(np.exp(-2)), np.log1p(np.exp(2))
    assert found.loss == pytest.approx((0.5 * missing + 0.5 * false + missing + false) / 3, rel=1e-6)
    with pytest.raises(InputError, match="expected an image with a vessel, found none in 3 images"):
        BatchEvaluation(network, DiceCrossEntropy(), lambda: batches(0 * masks))(network.state_dict())


def test_statistics_are_re_estimated_before_an_evaluation() -> None:
    torch.manual_seed(0)
    network = UNet(width=2, depth=2)()
    masks = (torch.rand(4, 1, 8, 8) > 0.5).float()
    weights = {name: tensor.clone() for name, tensor in network.state_dict().items()}
    images = [batch for batch, _ in batches(masks)]
    plain = BatchEvaluation(network, DiceCrossEntropy(), lambda: batches(masks))(weights)
    again = BatchEvaluation(network, DiceCrossEntropy(), lambda: batches(masks), lambda: images)
    refreshed = again(weights)
    assert refreshed.loss != plain.loss and again(weights) == refreshed
    assert not network.training
