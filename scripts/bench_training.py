"""Images a second of ``trainer.fit`` and of a bare torch loop of the same network, batches, augmentation and optimiser.

Both train the same epochs in turn, so that what else the machine does meets both alike; on a busy machine the ratio
of the processor time says more than that of the wall clock.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from quick_budget import parsed
from torch import Generator, Tensor, nn

from models.checkpoint import Checkpoint
from models.labelled_frames import LabelledFrames
from models.networks.registry import NetworkRecipe, recipe_of
from models.preprocessing.preprocessing import Preprocessing
from models.training.augmentation import Augmentation
from models.training.callback import TrainingCallback
from models.training.datamodule import FoldData
from models.training.deep_supervision import training_loss
from models.training.initialisation import initial_network
from models.training.losses import DiceCrossEntropy
from models.training.phase import Phase
from models.training.segmenter import Segmenter
from models.training.settings import TrainerSettings
from models.training.state import TrainingFolder
from models.training.trainer import lightning_trainer, quiet, reproducible
from models.weights import Weights

LOSS = DiceCrossEntropy()


@dataclass(frozen=True)
class Problem:
    """What either side trains."""

    model: NetworkRecipe
    settings: TrainerSettings
    train: LabelledFrames
    validation: LabelledFrames
    stage: Preprocessing

    def data(self) -> FoldData:
        """The batches of a fresh training."""
        return FoldData(
            self.train, self.validation, self.stage, Augmentation(), self.settings.batch_size, seed=0
        )


def discs(count: int, size_px: int) -> LabelledFrames:
    """Noise with a dark disc in it."""
    rng = np.random.default_rng(0)
    row, column = np.mgrid[:size_px, :size_px]
    images, masks = [], []
    for _ in range(count):
        centre = rng.uniform(0.3, 0.7, 2) * size_px
        mask = (row - centre[0]) ** 2 + (column - centre[1]) ** 2 < (0.2 * size_px) ** 2
        noise = rng.integers(0, 40, mask.shape, dtype=np.uint8)
        images.append(np.where(mask, 30, 150).astype(np.uint8) + noise)
        masks.append(mask)
    names = tuple(map(str, range(count)))
    return LabelledFrames(tuple(images), tuple(masks), names, names, (None,) * count, simulated=True)


def in_fit(problem: Problem, folder: Path | None) -> float:
    """Seconds of ``trainer.fit``; with a folder, the best weights and the state are written after each epoch."""
    return fitted(problem, folder)[0]


def fitted(problem: Problem, folder: Path | None) -> tuple[float, float]:
    """The same with the validation DSC of the best weights."""
    settings, data = problem.settings, problem.data()
    files = TrainingFolder(folder, "bench") if folder else None
    best = [0.0]

    def save(weights: Weights, epoch: int, dsc: float) -> None:
        best[0] = dsc
        if files is not None:
            Checkpoint(problem.model, weights, problem.stage).save(files.weights_path(epoch))

    callback = TrainingCallback(Phase.whole(settings), data, None, save, files.save if files else None)
    steps, network = data.steps_per_epoch, initial_network(problem.model, 0)
    module = Segmenter(
        network,
        LOSS,
        settings,
        lambda step: settings.learning_rate_factor(step, steps),
    )
    with reproducible(settings), quiet(), tempfile.TemporaryDirectory() as scratch:
        trainer = lightning_trainer(settings, callback, settings.max_epochs, Path(scratch))
        start_s = time.perf_counter()
        trainer.fit(module, datamodule=data)
        return time.perf_counter() - start_s, best[0]


def in_bare_loop(problem: Problem) -> float:
    """Seconds of the loop that one would write by hand."""
    settings, data = problem.settings, problem.data()
    device = torch.device("cpu" if settings.accelerator == "cpu" else "cuda")
    start_s = time.perf_counter()
    network = initial_network(problem.model, 0).to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]
    optimiser = torch.optim.AdamW(
        network.parameters(), lr=settings.learning_rate, weight_decay=settings.weight_decay
    )
    images, masks = data.train_set.tensors
    chance, step = Generator(device).manual_seed(0), 0
    mixed = torch.autocast(device.type, torch.bfloat16, enabled=settings.precision == "bf16-mixed")
    for _ in range(settings.max_epochs):
        network.train()
        for part in torch.randperm(len(images)).split(settings.batch_size):
            x, y = data.augmentation(images[part].to(device), masks[part].to(device).float(), chance)
            rate = settings.learning_rate * settings.learning_rate_factor(step, data.steps_per_epoch)
            for group in optimiser.param_groups:
                group["lr"] = rate
            with mixed:
                loss = training_loss(LOSS, network(_input(problem, x)), y)
            optimiser.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(network.parameters(), settings.gradient_clip)
            optimiser.step()
            step += 1
        _validate(problem, data, network, device, mixed)
    return time.perf_counter() - start_s


def _validate(
    problem: Problem, data: FoldData, network: nn.Module, device: torch.device, mixed: torch.autocast
) -> float:
    images, masks = data.validation_set.tensors
    network.eval()
    total = 0.0
    with torch.inference_mode(), mixed:
        for part in torch.arange(len(images)).split(problem.settings.batch_size):
            logits = network(_input(problem, images[part].to(device)))
            y = masks[part].to(device).float()
            predicted = (logits > 0).float()
            dsc = 2 * (predicted * y).sum((1, 2, 3)) / (predicted + y).sum((1, 2, 3)).clamp_min(1)
            total += float(dsc.sum()) + float(LOSS(logits, y))
    return total / len(images)


def _input(problem: Problem, images: Tensor) -> Tensor:
    return problem.stage.normalise(images).contiguous(memory_format=torch.channels_last)


def asked() -> argparse.Namespace:
    """What the command line says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--model", default="unet")
    parser.add_argument("--width", type=int, default=16)
    parser.add_argument("--size", type=int, default=128, help="side of the images in pixels")
    parser.add_argument("--batch", type=int, default=8)
    parser.add_argument(
        "--images", type=int, default=64, help="to train on; a quarter as many to validate on"
    )
    parser.add_argument("--epochs", type=int, default=2, help="of each training")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--gpu", action="store_true", help="on a GPU in bf16, else on the CPU")
    return parsed(parser, {"width": 8, "size": 64, "images": 16, "epochs": 1, "rounds": 1})


def problem_of(given: argparse.Namespace) -> Problem:
    """The training that was asked for."""
    settings = TrainerSettings(
        max_epochs=given.epochs,
        batch_size=given.batch,
        learning_rate=0.001,
        patience=given.epochs,
        accelerator="gpu" if given.gpu else "cpu",
        precision="bf16-mixed" if given.gpu else "32-true",
    )
    frames = discs(given.images + given.images // 4, given.size)
    return Problem(
        recipe_of(given.model, {"width": given.width}),
        settings,
        frames.subset(range(given.images)),
        frames.subset(range(given.images, len(frames))),
        Preprocessing(given.size),
    )


def main() -> None:
    """Print a line for each side, and the ratios."""
    given = asked()
    problem = problem_of(given)
    with tempfile.TemporaryDirectory() as folder:
        sides: dict[str, Callable[[], float]] = {
            "bare loop": lambda: in_bare_loop(problem),
            "trainer.fit": lambda: in_fit(problem, None),
            "trainer.fit, state written": lambda: in_fit(problem, Path(folder)),
        }
        times: dict[str, list[tuple[float, float]]] = {name: [] for name in sides}
        for number in range(given.rounds + 1):
            # No side always comes first.
            for name, side in sorted(sides.items(), reverse=number % 2 == 0):
                start_s = time.process_time()
                taken_s = side()
                if number:  # the first round warms up
                    times[name].append((taken_s, time.process_time() - start_s))
    shown = given.images * given.epochs
    bare = np.array(times["bare loop"])
    print(
        f"{'':28s}{'images_per_s':>14s}{'of_bare':>9s}{'by_cpu_time':>13s}   (median of {given.rounds} rounds)"
    )
    for name, seconds in times.items():
        ratio, by_cpu = np.median(bare / np.array(seconds), axis=0)
        images_per_s = shown / float(np.median(np.array(seconds)[:, 0]))
        print(f"{name:28s}{images_per_s:14.1f}{ratio:9.3f}{by_cpu:13.3f}")


if __name__ == "__main__":
    main()
