import math

import pytest
import torch

from models.networks.outputs import SideOutputs
from models.training.deep_supervision import training_loss
from models.training.losses import DiceCrossEntropy

LOSS = DiceCrossEntropy()


def masks() -> torch.Tensor:
    """A vessel in the first image, none in the second."""
    result = torch.zeros(2, 1, 4, 4)
    result[0, 0, 1:3, 1:3] = 1
    return result


def test_plain_logits_are_given_to_the_loss() -> None:
    logits = torch.randn(2, 1, 4, 4)
    assert torch.equal(training_loss(LOSS, logits, masks()), LOSS(logits, masks()))


def test_sides_count_as_much_as_the_final_logits() -> None:
    final, first, second = (torch.randn(2, 1, 4, 4) for _ in range(3))
    expected = sum(float(LOSS(logits, masks())) for logits in (final, first, second)) / 3
    outputs = SideOutputs(final, (first, second), None)
    assert float(training_loss(LOSS, outputs, masks())) == pytest.approx(expected)


def test_presence_is_held_against_whether_the_mask_has_a_vessel() -> None:
    logits = torch.randn(2, 1, 4, 4)
    presence = torch.tensor([math.log(3), math.log(3)])  # 3/4 each; right for the first, wrong for the second
    expected = float(LOSS(logits, masks())) + (math.log(4 / 3) + math.log(4)) / 2
    assert float(training_loss(LOSS, SideOutputs(logits, (), presence), masks())) == pytest.approx(expected)


def test_every_output_learns() -> None:
    tensors = [torch.randn(2, 1, 4, 4, requires_grad=True) for _ in range(3)]
    presence = torch.zeros(2, requires_grad=True)
    training_loss(LOSS, SideOutputs(tensors[0], tuple(tensors[1:]), presence), masks()).backward()
    assert all(tensor.grad.abs().sum() > 0 for tensor in tensors)
    # The first image has a vessel, the second has none.
    assert presence.grad.tolist() == [-0.25, 0.25]


def test_half_precision_presence_is_compared_in_32_bits() -> None:
    outputs = SideOutputs(torch.zeros(2, 1, 4, 4), (), torch.tensor([20.0, -20.0], dtype=torch.bfloat16))
    assert training_loss(LOSS, outputs, masks()).dtype == torch.float32
