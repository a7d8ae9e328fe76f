"""A training on two devices, here two processes of a CPU that talk by gloo: the same network, written once."""

from __future__ import annotations

import os
import signal
from collections.abc import Mapping
from pathlib import Path

import psutil
import pytest
import shared_runs
import torch
from drawn_vessels import drawn_frames
from shared_runs import SMALL

from models.checkpoint import Checkpoint
from models.errors import InputError
from models.networks.unet import UNet
from models.preprocessing.preprocessing import Preprocessing
from models.training.augmentation import Augmentation
from models.training.distributed import run_shared
from models.training.fold import train_fold
from models.training.losses import DiceCrossEntropy
from models.training.sampling import Share
from models.training.settings import TrainerSettings
from models.training.spec import FoldTraining

# Seven images in batches of three: the last batch has one image for two processes.
TRAIN, VALIDATION = drawn_frames(7, seed=0), drawn_frames(3, seed=1)
# Statistics of a batch would be those of a part of it.
RECIPE = UNet(width=4, depth=3, normalisation="instance")


def training(devices: int, epochs: int = 2, **changes: object) -> FoldTraining:
    given: dict = {"max_epochs": epochs, "batch_size": 3, "learning_rate": 0.01, "patience": epochs}
    trainer = TrainerSettings(**{**given, "devices": devices, "strategy": "ddp", **changes})
    return FoldTraining(
        model=RECIPE,
        train=TRAIN,
        validation=VALIDATION,
        preprocessing=Preprocessing(32),
        trainer=trainer,
        augmentation=Augmentation(),
        loss=DiceCrossEntropy(),
        seed=0,
        fold=0,
    )


class StoppedError(Exception):
    """Stands for whatever stops a training."""


def test_two_processes_train_one_network_and_write_it_once(tmp_path: Path) -> None:
    alone = train_fold(training(1), directory=tmp_path / "one")
    reports: list[Mapping[str, float]] = []
    shared = train_fold(
        training(2), directory=tmp_path / "two", state_directory=tmp_path / "state", on_epoch=reports.append
    )
    assert list(shared.history) == reports and len(reports) == 2
    assert [path.name for path in (tmp_path / "two").iterdir()] == ["model.pt"]
    assert shared.history[1]["train_loss"] < shared.history[0]["train_loss"]
    assert [one["learning_rate"] for one in shared.history] == [one["learning_rate"] for one in alone.history]
    # Overlaps over parts of batches are not those over whole ones, but near them.
    for name in ("train_loss", "validation_loss"):
        expected = [epoch[name] for epoch in alone.history]
        assert [epoch[name] for epoch in shared.history] == pytest.approx(expected, rel=0.05), name
    first = Checkpoint.load(shared.checkpoint)
    assert first.notes["start"] == Checkpoint.load(alone.checkpoint).notes["start"]
    assert all(torch.isfinite(tensor).all() for tensor in first.weights.values())


def children() -> list[psutil.Process]:
    return [child for child in psutil.Process().children() if "spawn_main" in " ".join(child.cmdline())]


def test_a_stop_ends_all_processes() -> None:
    def stop(report: Mapping[str, float]) -> None:
        assert len(children()) == 2
        raise StoppedError

    with pytest.raises(StoppedError):
        run_shared(shared_runs.report_and_wait, (SMALL,), 2, stop)
    assert not children()


def test_a_process_that_is_killed_ends_the_training() -> None:
    def kill(report: Mapping[str, float]) -> None:
        os.kill(children()[-1].pid, signal.SIGKILL)

    with pytest.raises(RuntimeError, match="ended by signal 9 before the training did"):
        run_shared(shared_runs.report_and_wait, (SMALL,), 2, kill)
    assert not children()


def test_what_went_wrong_in_a_process_is_raised_here() -> None:
    with pytest.raises(InputError, match="as process 1 has it"):
        run_shared(shared_runs.fail_in_the_second, (SMALL,), 2, None)
    assert not children()


@pytest.mark.parametrize("count", range(1, 8))
@pytest.mark.parametrize("processes", [1, 2, 3])
def test_the_weighted_means_of_the_parts_are_the_mean_of_the_whole(count: int, processes: int) -> None:
    values = torch.arange(1.0, count + 1) ** 2
    parts = [Share(number, processes).of(count) for number in range(processes)]
    together = sum(float(values[part].mean()) * weight for part, weight in parts) / processes
    assert together == pytest.approx(float(values.mean()))
    own = [index for part, weight in parts if weight for index in range(count)[part]]
    assert own == list(range(count))


def test_devices_that_are_not_there_or_have_no_image_are_refused() -> None:
    with pytest.raises(InputError, match="devices: expected at most one for each image of a batch"):
        training(4)
    with pytest.raises(InputError, match="devices: expected at least 1, received 0"):
        training(0)
    with pytest.raises(InputError, match="strategy: expected one of auto, ddp, received 'fsdp'"):
        training(1, strategy="fsdp")
    if torch.cuda.device_count() < 2:
        with pytest.raises(InputError, match="devices: expected at most the"):
            training(2, accelerator="auto")


def test_one_device_has_the_fingerprint_that_it_had_before_there_were_several() -> None:
    assert training(1).fingerprint == training(1, strategy="auto").fingerprint
    assert training(2).fingerprint != training(1).fingerprint
