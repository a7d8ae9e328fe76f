import math

import pytest
import torch

from models.errors import InputError
from models.training.losses import LOSSES, DiceCrossEntropy, DiceFocal, Focal, Loss, Tversky, loss_of


def test_undecided_logits_on_a_half_full_mask() -> None:
    masks = torch.tensor([1.0, 1.0, 0.0, 0.0]).reshape(1, 1, 2, 2)
    logits = torch.zeros(1, 1, 2, 2)
    # Overlap 1, probabilities and masks sum up to 4, one pixel of smoothing: 1 - (2 + 1) / (4 + 1).
    assert float(DiceCrossEntropy(cross_entropy_weight=0.0)(logits, masks)) == pytest.approx(0.4)
    assert float(DiceCrossEntropy(dice_weight=0.0)(logits, masks)) == pytest.approx(math.log(2))
    assert float(DiceCrossEntropy(2.0, 3.0)(logits, masks)) == pytest.approx(0.8 + 3 * math.log(2))


def test_right_is_zero_and_wrong_is_large() -> None:
    masks = (torch.rand(3, 1, 8, 8) > 0.5).float()
    sure = 100 * (2 * masks - 1)
    assert float(DiceCrossEntropy()(sure, masks)) == pytest.approx(0, abs=1e-6)
    assert float(DiceCrossEntropy()(-sure, masks)) > 50


def test_a_batch_without_any_vessel_is_defined() -> None:
    masks = torch.zeros(2, 1, 8, 8)
    assert float(DiceCrossEntropy()(torch.full_like(masks, -100.0), masks)) == pytest.approx(0, abs=1e-6)
    assert float(DiceCrossEntropy(cross_entropy_weight=0.0)(torch.zeros_like(masks), masks)) > 0.9


def test_dice_equals_monai_over_the_batch() -> None:
    from monai.losses import DiceLoss

    generator = torch.Generator().manual_seed(0)
    logits = 3 * torch.randn(4, 1, 9, 7, generator=generator)
    masks = (torch.rand(4, 1, 9, 7, generator=generator) > 0.7).float()
    peer = DiceLoss(sigmoid=True, batch=True, smooth_nr=2.5, smooth_dr=2.5)
    ours = DiceCrossEntropy(cross_entropy_weight=0.0, smooth=2.5)
    assert float(ours(logits, masks)) == pytest.approx(float(peer(logits, masks)), rel=1e-6)


def one_of_each() -> tuple[torch.Tensor, torch.Tensor]:
    """A pixel of vessel and one of background, each with probability 0.8 of vessel."""
    return torch.full((1, 1, 1, 2), math.log(4)), torch.tensor([1.0, 0.0]).reshape(1, 1, 1, 2)


def test_focal_by_hand() -> None:
    logits, masks = one_of_each()
    # The right answer has 0.8 on the vessel's pixel and 0.2 on the other.
    vessel, background = 0.2**2 * -math.log(0.8), 0.8**2 * -math.log(0.2)
    assert float(Focal(alpha=None)(logits, masks)) == pytest.approx((vessel + background) / 2)
    assert float(Focal()(logits, masks)) == pytest.approx((0.25 * vessel + 0.75 * background) / 2)
    assert float(Focal(0.0, None)(logits, masks)) == pytest.approx(-math.log(0.8 * 0.2) / 2)


def test_focal_equals_monai() -> None:
    from monai.losses import FocalLoss

    generator = torch.Generator().manual_seed(0)
    logits = 5 * torch.randn(3, 1, 9, 7, generator=generator)
    masks = (torch.rand(3, 1, 9, 7, generator=generator) > 0.7).float()
    for gamma, alpha in ((2.0, 0.25), (0.5, None), (3.0, 0.9)):
        peer = FocalLoss(gamma=gamma, alpha=alpha)(logits, masks)
        assert float(Focal(gamma, alpha)(logits, masks)) == pytest.approx(float(peer), rel=1e-5)


def test_dice_focal_is_the_weighted_sum() -> None:
    logits, masks = one_of_each()
    dice = float(DiceCrossEntropy(cross_entropy_weight=0.0)(logits, masks))
    focal = float(Focal(alpha=None)(logits, masks))
    assert float(DiceFocal(2.0, 3.0)(logits, masks)) == pytest.approx(2 * dice + 3 * focal)


def test_tversky_by_hand() -> None:
    logits, masks = one_of_each()
    # 0.8 of a pixel found, 0.8 false, 0.2 missed, and one pixel of smoothing.
    missed = 1 - (0.8 + 1) / (0.8 + 0.3 * 0.8 + 0.7 * 0.2 + 1)
    assert float(Tversky()(logits, masks)) == pytest.approx(missed)
    assert float(Tversky(gamma=4 / 3)(logits, masks)) == pytest.approx(missed**0.75)


def test_tversky_of_equal_weights_is_dice() -> None:
    logits, masks = one_of_each()
    dice = DiceCrossEntropy(cross_entropy_weight=0.0, smooth=2.0)
    assert float(Tversky(0.5, 0.5, smooth=1.0)(logits, masks)) == pytest.approx(float(dice(logits, masks)))


EVERY_LOSS = [DiceCrossEntropy(), DiceFocal(), Focal(), Focal(0.5), Tversky(), Tversky(gamma=4 / 3)]


@pytest.mark.parametrize("loss", EVERY_LOSS, ids=str)
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
@pytest.mark.parametrize("right", [1, -1])
def test_values_and_slopes_are_finite_however_sure_the_network_is(
    loss: Loss, scale: float, right: int
) -> None:
    masks = torch.zeros(2, 1, 4, 4)
    masks[0, 0, :2] = 1
    logits = (right * scale * (2 * masks - 1)).requires_grad_()
    value = loss(logits, masks)
    value.backward()
    assert torch.isfinite(value) and value >= 0 and torch.isfinite(logits.grad).all()


@pytest.mark.parametrize("loss", EVERY_LOSS, ids=str)
def test_a_step_down_the_slope_makes_the_logits_righter(loss: Loss) -> None:
    masks = torch.zeros(2, 1, 4, 4)
    masks[0, 0, :2] = 1
    logits = torch.zeros_like(masks, requires_grad=True)
    loss(logits, masks).backward()
    assert ((logits.grad < 0) == (masks > 0)).all()


@pytest.mark.parametrize("loss", EVERY_LOSS, ids=str)
@pytest.mark.parametrize("kind", [torch.float16, torch.bfloat16])
def test_16_bit_logits_of_many_pixels_lose_nothing_but_their_own_rounding(
    loss: Loss, kind: torch.dtype
) -> None:
    generator = torch.Generator().manual_seed(0)
    # 131072 pixels: more than a 16-bit float can count to.
    logits = torch.randn(2, 1, 256, 256, generator=generator).to(kind)
    masks = (torch.rand(2, 1, 256, 256, generator=generator) > 0.7).float()
    value = loss(logits, masks.to(kind))
    assert value.dtype == torch.float32
    assert float(value) == pytest.approx(float(loss(logits.double(), masks)), rel=1e-5)


def test_a_loss_is_found_by_its_name() -> None:
    assert loss_of("tversky", {"gamma": 1.5}) == Tversky(gamma=1.5)
    assert all(name == loss.name and isinstance(loss(), Loss) for name, loss in LOSSES.items())
    with pytest.raises(InputError, match=r"loss: expected one of dice_cross_entropy, .* received 'hinge'"):
        loss_of("hinge", {})
    with pytest.raises(InputError, match="loss: expected settings of focal, received others"):
        loss_of("focal", {"smooth": 1.0})


@pytest.mark.parametrize(
    ("loss", "settings", "message"),
    [
        (DiceCrossEntropy, {"dice_weight": -1.0}, "dice_weight: expected a number from 0, received -1.0"),
        (DiceCrossEntropy, {"dice_weight": 0.0, "cross_entropy_weight": 0.0}, "expected one above 0"),
        (DiceCrossEntropy, {"smooth": 0.0}, "smooth: expected a positive number of pixels, received 0.0"),
        (DiceFocal, {"focal_weight": math.nan}, "focal_weight: expected a number from 0, received nan"),
        (DiceFocal, {"gamma": -0.5}, "gamma: expected a number from 0, received -0.5"),
        (Focal, {"gamma": math.inf}, "gamma: expected a number from 0, received inf"),
        (Focal, {"alpha": 1.0}, "alpha: expected a number between 0 and 1 or none, received 1.0"),
        (Tversky, {"false_positive_weight": -0.1}, "false_positive_weight: expected a number from 0"),
        (Tversky, {"gamma": 0.75}, "gamma: expected a number from 1, received 0.75"),
        (Tversky, {"smooth": -1.0}, "smooth: expected a positive number of pixels, received -1.0"),
    ],
)
def test_refuses_settings(loss: type, settings: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        loss(**settings)
