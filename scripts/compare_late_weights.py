"""Which weights of a training to keep: latest or averaged, of the best, a smoothed or the last epoch.

Averaging does not change the steps of a training, so that one training a fold is enough for all rules: after every
epoch the latest weights and both averages are scored on the validation and on the unseen cases, at the network's
resolution. Each rule then chooses an epoch by the validation scores alone, and is judged by the unseen cases.
"""

from __future__ import annotations

import argparse
import itertools
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from lightning.pytorch import LightningModule, Trainer
from torch import Tensor, nn

from experiments import registry
from experiments.cli import compose_sweep
from experiments.datasets.protocol import outside_groups
from experiments.statistics import Bootstrap
from models.preprocessing.preprocessing import Preprocessing
from models.processor import fixed_threads
from models.seeds import TRAINING, seed_of
from models.training.callback import TrainingCallback
from models.training.datamodule import FoldData, prepared
from models.training.late_weights import LateWeights
from models.training.phase import Phase
from models.training.segmenter import Segmenter
from models.training.selection import EpochSelection
from models.training.settings import LATE_WEIGHTS
from models.training.trainer import fit, lightning_trainer, quiet, reproducible

RULES = [EpochSelection("best"), EpochSelection("smoothed", 5), EpochSelection("last")]
PARTS = ("model", "preprocessing", "augmentation", "loss", "init")
COLUMNS = ("seed", "fold", "epoch", "late_weights", "part", "case_id", "group", "dsc", "shown")


def scores(network: nn.Module, images: Tensor, masks: Tensor, stage: Preprocessing, batch: int) -> np.ndarray:
    """DSC (NaN without a vessel) and whether anything is marked, a row for each case."""
    rows = []
    network.eval()
    with torch.inference_mode():
        for first in range(0, len(images), batch):
            part = slice(first, first + batch)
            marked = network(stage.normalise(images[part])) > 0
            reference = masks[part]
            overlap, size = (
                (marked & reference).sum((1, 2, 3)),
                marked.sum((1, 2, 3)) + reference.sum((1, 2, 3)),
            )
            dsc = torch.where(reference.any(3).any(2).any(1), 2.0 * overlap / size.clamp_min(1), torch.nan)
            rows.append(torch.stack([dsc, marked.any(3).any(2).any(1).float()], dim=1))
    return torch.cat(rows).numpy()


class Recorder(TrainingCallback):
    """Scores the latest weights and every average after each epoch."""

    def prepare(self, parts: dict[str, Any], batch: int, where: tuple[int, int]) -> None:
        """Set the cases to score, by the part of the fold that they are in."""
        steps, settings = self.data.steps_per_epoch, self.phase.settings
        self.every = {kind: LateWeights(replace(settings, late_weights=kind), steps) for kind in LATE_WEIGHTS}
        self.rows: list[tuple[Any, ...]] = []
        self.parts, self.batch, self.where = parts, batch, where
        self.pixels = {
            name: prepared(frames, self.data.preprocessing).tensors for name, frames in parts.items()
        }

    def on_train_batch_end(self, trainer: Trainer, pl_module: LightningModule, *rest: Any) -> None:
        """Let the averages take the step."""
        super().on_train_batch_end(trainer, pl_module, *rest)
        for late in self.every.values():
            late.after_step(pl_module.network)  # type: ignore[arg-type]

    def on_validation_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Score all weights."""
        super().on_validation_end(trainer, pl_module)
        assert isinstance(pl_module, Segmenter)
        network, epoch = pl_module.network, len(self.history)
        for kind, late in self.every.items():
            late.after_epoch(network, epoch)
            with late.in_place(network, lambda: self.data.plain_training_images(pl_module.device)):
                self._score(network, kind, epoch)

    def _score(self, network: nn.Module, kind: str, epoch: int) -> None:
        for part, frames in self.parts.items():
            found = scores(network, *self.pixels[part], self.data.preprocessing, self.batch)
            cases = zip(frames.case_ids, frames.groups, found, strict=True)
            self.rows += [(*self.where, epoch, kind, part, case, group, *row) for case, group, row in cases]


def train(job: dict[str, Any], split: Any, frames: Any, fold: int, seed: int) -> pd.DataFrame:
    """Train one fold for all its epochs and return the scores of every epoch."""
    parts = {name: registry.build(job[name], name) for name in PARTS}
    settings = replace(registry.build(job["trainer"], "trainer"), patience=10**6)
    sides = {side: split.of(frames, side) for side in ("train", "validation", "test")}
    with (
        fixed_threads(settings.threads),
        reproducible(settings),
        quiet(),
        tempfile.TemporaryDirectory() as scratch,
    ):
        data = FoldData(
            sides["train"],
            sides["validation"],
            parts["preprocessing"],
            parts["augmentation"],
            settings.batch_size,
            seed_of(seed, TRAINING, fold),
            settings.empty_weight,
        )
        phase, steps = Phase.whole(settings), data.steps_per_epoch
        recorder = Recorder(phase, data, None, lambda weights, epoch, dsc: None)
        recorder.prepare(
            {side: sides[side] for side in ("validation", "test")}, settings.batch_size, (seed, fold)
        )
        network = parts["init"](parts["model"], seed).network(parts["model"])
        module = Segmenter(
            network, parts["loss"], settings, lambda step: phase.learning_rate_factor(step, steps)
        )
        fit(lightning_trainer(settings, recorder, settings.max_epochs, Path(scratch)), module, data)
    return pd.DataFrame(recorder.rows, columns=list(COLUMNS))


def judged(table: pd.DataFrame) -> pd.DataFrame:
    """One row for each rule and kind of weights: the unseen cases' DSC, its difference to today's, alarms, misses."""
    chosen: dict[tuple[str, str], pd.DataFrame] = {}
    for kind, rule in itertools.product(LATE_WEIGHTS, RULES):
        own, rows = table[table["late_weights"] == kind], []
        for _, fold in own.groupby(["seed", "fold"]):
            validation = fold[fold["part"] == "validation"].groupby("epoch")["dsc"].mean()
            epoch = rule.kept([{"validation_dsc": dsc} for dsc in validation])
            rows.append(fold[(fold["part"] == "test") & (fold["epoch"] == epoch)])
        chosen[kind, rule.rule] = pd.concat(rows)
    today, found = _by_case(chosen["none", "best"]), []
    for (kind, rule), cases in chosen.items():
        change = (_by_case(cases) - today).dropna()
        bounds = Bootstrap("mean_of_cases")(change, [group for group, _ in change.index])
        empty, seeds = cases[cases["dsc"].isna()], cases["seed"].nunique()
        found.append(
            {
                "late_weights": kind,
                "selection": rule,
                "dsc": cases["dsc"].mean(),
                "change": change.mean(),
                "change_low": bounds.low,
                "change_high": bounds.high,
                "missed": int((cases[cases["dsc"].notna()]["shown"] == 0).sum()) / seeds,
                "false_alarms": int(empty["shown"].sum()) / seeds,
                "empty": len(empty) / seeds,
            }
        )
    return pd.DataFrame(found)


def _by_case(cases: pd.DataFrame) -> pd.Series:
    return cases.groupby(["group", "case_id"])["dsc"].mean()


def main(arguments: Sequence[str] | None = None) -> None:
    """Train what is missing in the folder of results and print the comparison."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--out", type=Path, required=True, help="folder for a table of scores for each seed and fold"
    )
    # Not nargs="+", which would take the overrides that follow for seeds.
    parser.add_argument("--seeds", type=_whole_numbers, default=[0, 1, 2], help="such as 0,1,2")
    parser.add_argument("--fold", type=int, help="train this fold alone, to share the work between processes")
    parser.add_argument("overrides", nargs="*", help="settings of study=segmentation, such as dataset=usgra")
    given = parser.parse_args(arguments)
    given.out.mkdir(parents=True, exist_ok=True)
    for seed in given.seeds:
        ((job, _),) = compose_sweep(["study=segmentation", *given.overrides, f"seed={seed}"])
        dataset = registry.build(job["dataset"], "dataset")
        frames = dataset()
        for split in registry.build(job["split"], "split")(frames, **outside_groups(dataset)):
            path = given.out / f"seed-{seed}-fold-{split.fold}.parquet"
            if not path.is_file() and given.fold in (None, split.fold):
                train(job, split, frames, split.fold, seed).to_parquet(path)
    _show(given.out.glob("seed-*.parquet"))


def _whole_numbers(text: str) -> list[int]:
    return [int(number) for number in text.split(",")]


def _show(paths: Iterable[Path]) -> None:
    table = pd.concat([pd.read_parquet(path) for path in sorted(paths)], ignore_index=True)
    print(judged(table).to_string(index=False, float_format="%.4f"))


if __name__ == "__main__":
    main()
