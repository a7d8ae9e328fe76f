import math

import pytest
import torch
from torch import nn

from models.networks.outputs import SideOutputs
from models.training.losses import DiceCrossEntropy
from models.training.segmenter import Segmenter
from models.training.settings import TrainerSettings

SETTINGS = TrainerSettings(max_epochs=4, batch_size=2, learning_rate=0.5, patience=2, warmup_epochs=0)


def segmenter() -> Segmenter:
    return Segmenter(nn.Conv2d(1, 1, 1), DiceCrossEntropy(), SETTINGS, lambda step: 1 / (1 + step), step=3)


def logits_as_images() -> Segmenter:
    module = segmenter()
    module.network = nn.Identity()
    return module


def test_validation_dsc_is_the_mean_over_images_with_a_vessel() -> None:
    module = logits_as_images()
    masks = torch.zeros(3, 1, 2, 4)
    masks[0, 0, 0] = masks[1, 0, 0] = 1  # the third shows no vessel
    logits = torch.full((3, 1, 2, 4), -5.0)
    logits[0, 0, 0] = 5.0  # right
    logits[1, 0, 0, :2] = logits[1, 0, 1, :2] = 5.0  # half right
    logits[2] = 5.0  # a false alarm, which the DSC doesn't count
    module.validation_step([logits[:2], masks[:2]], 0)
    module.validation_step([logits[2:], masks[2:]], 1)
    measures = module.take_measures()
    assert measures["validation_dsc"] == pytest.approx((1.0 + 0.5) / 2)
    assert set(measures) == {"validation_dsc", "validation_loss"}


def test_losses_are_those_since_they_were_last_taken() -> None:
    module = logits_as_images()
    masks = torch.tensor([1.0, 1.0, 0.0, 0.0]).reshape(1, 1, 2, 2)
    module.training_step([torch.zeros(1, 1, 2, 2), masks], 0)
    module.training_step([100 * (2 * masks - 1), masks], 1)
    assert module.take_measures() == {"train_loss": pytest.approx((0.4 + math.log(2)) / 2)}
    assert module.take_measures() == {}


def test_the_learning_rate_is_that_of_the_step_from_the_one_it_begins_at() -> None:
    made = segmenter().configure_optimizers()
    optimiser, schedule = made["optimizer"], made["lr_scheduler"]["scheduler"]
    assert made["lr_scheduler"]["interval"] == "step"
    for step in (3, 4, 5):
        assert optimiser.param_groups[0]["lr"] == 0.5 / (1 + step)
        optimiser.step()
        schedule.step()


def test_side_outputs_are_trained_too() -> None:
    class Two(nn.Module):
        def forward(self, images: torch.Tensor) -> SideOutputs:
            return SideOutputs(images, (-images,))

    module = segmenter()
    module.network = Two()
    images, masks = torch.full((1, 1, 2, 2), 3.0), torch.ones(1, 1, 2, 2)
    loss = DiceCrossEntropy()
    expected = (loss(images, masks) + loss(-images, masks)) / 2
    assert float(module.training_step([images, masks], 0)) == pytest.approx(float(expected))
