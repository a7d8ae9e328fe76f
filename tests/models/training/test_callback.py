from unittest.mock import Mock

import pytest
import torch
from drawn_vessels import drawn_frames
from lightning.pytorch import Trainer
from torch import nn

from models.preprocessing.preprocessing import Preprocessing
from models.training import callback
from models.training.augmentation import Augmentation
from models.training.callback import TrainingCallback
from models.training.datamodule import FoldData
from models.training.losses import DiceCrossEntropy
from models.training.phase import Phase
from models.training.segmenter import Segmenter
from models.training.settings import TrainerSettings
from models.training.state import TrainingState

SETTINGS = TrainerSettings(max_epochs=6, batch_size=2, learning_rate=0.5, patience=3)
STAGE = Preprocessing(32)


def data() -> FoldData:
    return FoldData(drawn_frames(4), drawn_frames(2), STAGE, Augmentation(), batch_size=2, seed=0)


class Training:
    """A training led by hand through epochs of known validation DSC."""

    def __init__(self, start: TrainingState | None = None, save_state=None) -> None:
        self.saved: list[tuple[int, float]] = []
        self.seen: list[dict[str, float]] = []
        self.module = Segmenter(nn.Conv2d(1, 1, 1), DiceCrossEntropy(), SETTINGS, lambda step: 0.1)
        self.optimiser = self.module.configure_optimizers()["optimizer"]
        self.trainer = Mock(spec=Trainer, optimizers=[self.optimiser], should_stop=False)
        self.trainer.precision_plugin.state_dict.return_value = {"scale": 2.0}
        self.callback = TrainingCallback(
            Phase.whole(SETTINGS),
            data(),
            start,
            lambda network, epoch, dsc: self.saved.append((epoch, dsc)),
            save_state,
            self.seen.append,
        )

    def epoch(self, dsc: float) -> None:
        self.callback.on_train_epoch_start(self.trainer, self.module)
        for batch in range(2):
            self.callback.on_train_batch_start(self.trainer, self.module, [], batch)
            self.callback.on_train_batch_end(
                self.trainer, self.module, None, [torch.zeros(2, 1, 8, 8)], batch
            )
        self.callback.on_validation_start(self.trainer, self.module)
        self.callback.on_validation_end(self.trainer, self.module)
        self.module.take_measures = lambda: {"validation_loss": 0.3, "validation_dsc": dsc}
        self.callback.on_train_epoch_end(self.trainer, self.module)


def test_the_best_weights_are_saved_and_each_epoch_is_reported() -> None:
    led = Training()
    for dsc in (0.2, 0.5, 0.5, 0.4):
        led.epoch(dsc)
    assert led.saved == [(0, 0.2), (1, 0.5)]
    assert led.seen == led.callback.history and len(led.seen) == 4
    assert led.seen[0]["images_per_s"] > 0 and led.seen[0]["learning_rate"] == 0.05
    assert not led.trainer.should_stop
    led.epoch(0.1)
    assert led.trainer.should_stop


def test_an_epoch_with_a_dsc_of_zero_is_still_kept() -> None:
    led = Training()
    led.epoch(0.0)
    assert led.saved == [(0, 0.0)]


def test_random_numbers_of_an_epoch_depend_on_its_number_alone() -> None:
    first, second = Training(), Training()
    drawn = []
    for led, epochs in ((first, 3), (second, 3)):
        for _ in range(epochs):
            led.epoch(0.5)
            torch.rand(1 if led is first else 4)  # whatever else is drawn
        led.callback.on_train_epoch_start(led.trainer, led.module)
        drawn.append((torch.rand(3), [images for images, _ in led.callback.data.train_dataloader()]))
    assert torch.equal(drawn[0][0], drawn[1][0])
    assert all(torch.equal(a, b) for a, b in zip(drawn[0][1], drawn[1][1], strict=True))


def test_a_training_is_resumed_from_a_state() -> None:
    states: list[TrainingState] = []
    led = Training(save_state=lambda state, kept: states.append(state))
    led.epoch(0.4)
    on = Training(start=states[0])
    assert on.seen == list(states[0].history) == led.seen
    on.callback.on_train_start(on.trainer, on.module)
    on.trainer.precision_plugin.load_state_dict.assert_called_once_with({"scale": 2.0})
    assert on.callback.runtime_s >= states[0].runtime_s
    on.epoch(0.3)
    assert on.saved == [] and len(on.callback.history) == 2


def test_writing_states_takes_a_tenth_of_the_time_at_most_but_the_last_is_always_written(monkeypatch) -> None:
    now_s = [0.0]
    monkeypatch.setattr(callback.time, "perf_counter", lambda: now_s[0])
    written: list[int] = []

    def write(state: TrainingState, kept: int) -> None:
        now_s[0] += 3.0
        written.append(len(state.history))

    led = Training(save_state=write)
    monkeypatch.setattr(led.callback._throughput, "start", lambda: None)
    for dsc in (0.1, 0.2, 0.3, 0.4, 0.5, 0.6):
        now_s[0] += 12.0
        led.epoch(dsc)
    # After the first, 30 s have to pass for each 3 s of writing; the sixth is the last.
    assert written == [1, 4, 6]


def test_a_loss_that_is_no_number_ends_the_training() -> None:
    led = Training()
    led.module.take_measures = lambda: {"validation_loss": float("nan"), "validation_dsc": 0.0}
    led.callback._throughput.count(1, last=True)
    with pytest.raises(RuntimeError, match="expected a finite validation loss, received nan after 1 epochs"):
        led.callback.on_train_epoch_end(led.trainer, led.module)
    assert led.saved == [] and led.seen == []
