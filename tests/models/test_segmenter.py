import math
from unittest.mock import Mock

import pytest
import torch
from lightning.pytorch import Trainer
from torch import nn

from models.losses import DiceCrossEntropy
from models.segmenter import EpochReports, Segmenter
from models.trainer_settings import TrainerSettings

SETTINGS = TrainerSettings(
    max_epochs=4, batch_size=2, image_size_px=8, learning_rate=0.5, patience=2, warmup_epochs=0
)


def segmenter() -> Segmenter:
    return Segmenter(nn.Conv2d(1, 1, 1), DiceCrossEntropy(), SETTINGS, steps_per_epoch=5)


def logits_as_images() -> Segmenter:
    module = segmenter()
    module.network = nn.Identity()
    return module


def test_validation_dsc_is_the_mean_over_images_with_a_vessel(monkeypatch) -> None:
    module = logits_as_images()
    masks = torch.zeros(3, 1, 2, 4)
    masks[0, 0, 0] = masks[1, 0, 0] = 1  # the third shows no vessel
    logits = torch.full((3, 1, 2, 4), -5.0)
    logits[0, 0, 0] = 5.0  # right
    logits[1, 0, 0, :2] = logits[1, 0, 1, :2] = 5.0  # half right
    logits[2] = 5.0  # a false alarm, which the DSC doesn't count
    logged = {}
    monkeypatch.setattr(module, "log", lambda name, value: logged.update({name: float(value)}))
    module.validation_step([logits[:2], masks[:2]], 0)
    module.validation_step([logits[2:], masks[2:]], 1)
    module.on_validation_epoch_end()
    assert logged == {"validation_dsc": pytest.approx((1.0 + 0.5) / 2)}


def test_losses_are_those_since_they_were_last_taken() -> None:
    module = logits_as_images()
    masks = torch.tensor([1.0, 1.0, 0.0, 0.0]).reshape(1, 1, 2, 2)
    module.training_step([torch.zeros(1, 1, 2, 2), masks], 0)
    module.training_step([100 * (2 * masks - 1), masks], 1)
    assert module.take_losses() == {"train_loss": pytest.approx((0.4 + math.log(2)) / 2)}
    assert module.take_losses() == {}


def test_optimiser_follows_the_settings_step_by_step() -> None:
    configured = segmenter().configure_optimizers()
    optimiser, schedule = configured["optimizer"], configured["lr_scheduler"]["scheduler"]
    assert configured["lr_scheduler"]["interval"] == "step"
    rates = []
    for _ in range(21):
        rates.append(optimiser.param_groups[0]["lr"])
        optimiser.step()
        schedule.step()
    assert rates[0] == 0.5 and rates[10] == pytest.approx(0.25) and rates[20] == pytest.approx(0.0, abs=1e-9)


def trainer_at(epoch: int, dsc: float) -> Mock:
    return Mock(
        spec=Trainer,
        current_epoch=epoch,
        callback_metrics={"validation_dsc": torch.tensor(dsc)},
        optimizers=[Mock(param_groups=[{"lr": 0.1}])],
    )


def test_reports_keep_the_best_epoch_and_pass_each_on() -> None:
    saved, seen = [], []
    reports = EpochReports(lambda network, epoch, dsc: saved.append((epoch, dsc)), seen.append)
    module = logits_as_images()
    for epoch, dsc in enumerate([0.2, 0.5, 0.5, 0.4]):
        reports.on_train_epoch_end(trainer_at(epoch, dsc), module)
    assert [epoch for epoch, _ in saved] == [0, 1]
    assert reports.best_epoch == 1 and reports.best_dsc == pytest.approx(0.5)
    assert seen == reports.history and len(seen) == 4
    assert seen[0] == {"learning_rate": 0.1, "validation_dsc": pytest.approx(0.2)}


def test_an_epoch_with_a_dsc_of_zero_is_still_kept() -> None:
    saved = []
    reports = EpochReports(lambda network, epoch, dsc: saved.append(epoch), None)
    reports.on_train_epoch_end(trainer_at(0, 0.0), logits_as_images())
    assert saved == [0]
