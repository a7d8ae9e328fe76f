import math

import pytest
import torch

from models.errors import InputError
from models.losses import DiceCrossEntropy


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


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"dice_weight": -1.0}, "dice_weight: expected a number from 0, received -1.0"),
        ({"dice_weight": 0.0, "cross_entropy_weight": 0.0}, "expected one above 0"),
        ({"smooth": 0.0}, "smooth: expected a positive number of pixels, received 0.0"),
    ],
)
def test_refuses_settings(settings: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        DiceCrossEntropy(**settings)
