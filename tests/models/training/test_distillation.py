import math

import pytest
import torch
from torch import Tensor, nn

from models.errors import InputError
from models.training.distillation import Distillation, DistillationWithReference
from models.training.losses import DiceCrossEntropy, Loss


def pixel(value: float) -> Tensor:
    return torch.tensor(value).reshape(1, 1, 1, 1)


def test_one_pixel_by_hand() -> None:
    # The student says 0.5, the ensemble 0.8.
    divergence = 0.8 * math.log(0.8 / 0.5) + 0.2 * math.log(0.2 / 0.5)
    assert float(Distillation(overlap_weight=0.0)(pixel(0.0), pixel(0.8))) == pytest.approx(
        divergence, rel=1e-5
    )
    overlap = Distillation(divergence_weight=0.0, smooth=0.5)(pixel(0.0), pixel(0.8))
    assert float(overlap) == pytest.approx(0.3 / (0.5 + 0.8 + 0.5), rel=1e-5)
    both = Distillation(2.0, 3.0, smooth=0.5)(pixel(0.0), pixel(0.8))
    assert float(both) == pytest.approx(2 * divergence + 3 * 0.3 / 1.8, rel=1e-5)


def test_a_temperature_softens_both_sides_by_hand() -> None:
    # Logits of 0 and log 4: halved, the ensemble says 2 / 3.
    divergence = 2 / 3 * math.log(2 / 3 / 0.5) + 1 / 3 * math.log(1 / 3 / 0.5)
    loss = Distillation(overlap_weight=0.0, temperature=2.0)(pixel(0.0), pixel(0.8))
    assert float(loss) == pytest.approx(4 * divergence, rel=1e-5)


@pytest.mark.parametrize("temperature", [1.0, 3.0])
def test_equal_to_the_ensemble_is_zero_and_a_minimum(temperature: float) -> None:
    generator = torch.Generator().manual_seed(0)
    logits = (3 * torch.randn(2, 1, 6, 5, generator=generator)).requires_grad_()
    ensemble = torch.sigmoid(logits.detach())
    loss = Distillation(temperature=temperature)
    assert float(loss(logits.detach(), ensemble)) == pytest.approx(0, abs=1e-5)
    (gradient,) = torch.autograd.grad(
        Distillation(overlap_weight=0.0, temperature=temperature)(logits, ensemble), logits
    )
    assert float(gradient.abs().max()) < 1e-6
    for _ in range(10):
        other = logits.detach() + 0.3 * torch.randn(logits.shape, generator=generator)
        assert float(loss(other, ensemble)) > 1e-3


def test_sure_ensembles_and_empty_batches_are_finite() -> None:
    masks = torch.zeros(2, 1, 4, 4)
    loss = Distillation()
    assert float(loss(torch.full_like(masks, -20.0), masks)) < 1e-4
    wrong = loss(torch.full_like(masks, 50.0), masks)
    assert math.isfinite(float(wrong)) and float(wrong) > 10
    logits = torch.zeros_like(masks, requires_grad=True)
    loss(logits, masks).backward()
    assert logits.grad is not None and bool(torch.isfinite(logits.grad).all())


def test_it_is_a_loss_as_the_others_are() -> None:
    assert isinstance(Distillation(), Loss)
    logits, probability = torch.randn(1, 1, 4, 4).half(), torch.rand(1, 1, 4, 4).half()
    assert Distillation()(logits, probability).dtype == torch.float32


def network(seed: int) -> nn.Module:
    torch.manual_seed(seed)
    return nn.Sequential(nn.Conv2d(1, 6, 3, padding=1), nn.ReLU(), nn.Conv2d(6, 1, 3, padding=1))


def test_a_small_network_learns_what_an_ensemble_says() -> None:
    generator = torch.Generator().manual_seed(1)
    images = torch.rand(8, 1, 12, 12, generator=generator)
    with torch.no_grad():
        ensemble = torch.stack([torch.sigmoid(4 * network(seed)(images)) for seed in range(3)]).mean(0)
    student, loss = network(7), Distillation()
    optimiser = torch.optim.Adam(student.parameters(), lr=0.03)
    losses = []
    for _ in range(150):
        optimiser.zero_grad()
        value = loss(student(images), ensemble)
        value.backward()
        optimiser.step()
        losses.append(value.item())
    with torch.no_grad():
        learned = torch.sigmoid(student(images))
        untrained = torch.sigmoid(network(7)(images))
    assert losses[-1] < 0.15 * losses[0]
    assert float((learned - ensemble).abs().mean()) < 0.2 * float((untrained - ensemble).abs().mean())


def test_a_reference_has_its_share() -> None:
    generator = torch.Generator().manual_seed(0)
    logits, ensemble = (
        torch.randn(1, 1, 4, 4, generator=generator),
        torch.rand(1, 1, 4, 4, generator=generator),
    )
    masks = (torch.rand(1, 1, 4, 4, generator=generator) > 0.5).float()
    soft, hard = Distillation()(logits, ensemble), DiceCrossEntropy()(logits, masks)
    for share in (0.0, 0.3, 1.0):
        mixed = DistillationWithReference(Distillation(), DiceCrossEntropy(), share)(logits, masks, ensemble)
        assert float(mixed) == pytest.approx(share * float(soft) + (1 - share) * float(hard), rel=1e-6)


def test_refuses_settings_out_of_range() -> None:
    for weights in ((0.0, 0.0), (-1.0, 2.0), (math.inf, 1.0)):
        with pytest.raises(InputError, match="divergence_weight, overlap_weight: expected"):
            Distillation(*weights)
    with pytest.raises(InputError, match="temperature: expected a number from 1"):
        Distillation(temperature=0.5)
    with pytest.raises(InputError, match="smooth: expected a positive number"):
        Distillation(smooth=0.0)
    with pytest.raises(InputError, match="ensemble_share: expected 0 to 1"):
        DistillationWithReference(Distillation(), DiceCrossEntropy(), 1.5)
