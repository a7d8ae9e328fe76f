"""The trainings of a job: the folds of one or two networks, and a network distilled from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from experiments.analysis.segmentation.fold_run import FoldRun
from experiments.outcome import Progress
from experiments.splits.split_set import SplitSet
from models.averaging import Member, weights_digest
from models.checkpoint import Checkpoint
from models.labelled_frames import LabelledFrames
from models.training.fold import initial_network

if TYPE_CHECKING:
    from models.networks.registry import NetworkRecipe
    from models.training.fold import TrainedFold


@dataclass(frozen=True)
class TrainedFolds:
    """The folds' networks of one architecture.

    Parameters
    ----------
    members : tuple of Member
        Networks in the order of the folds.
    trained : tuple of TrainedFold
        How their trainings went.
    """

    members: tuple[Member, ...]
    trained: tuple[TrainedFold, ...]

    @property
    def runtime_s(self) -> float:
        """Time of all trainings in s, those that were made earlier included."""
        return sum(one.runtime_s for one in self.trained)


def train_folds(
    run: FoldRun,
    model: NetworkRecipe,
    frames: LabelledFrames,
    splits: SplitSet,
    folder: Path,
    progress: Progress,
) -> TrainedFolds:
    """Train the network in every fold, all from the same start; a finished training of the same kind is used again.

    Parameters
    ----------
    run : FoldRun
        Settings of the trainings; network and fold are replaced.
    model : NetworkRecipe
        Network.
    frames : LabelledFrames
        All cases.
    splits : SplitSet
        The folds.
    folder : Path
        Folder for the checkpoints.
    progress : Progress
        Shows the epochs.

    Returns
    -------
    TrainedFolds
        The networks.
    """
    members, trained = [], []
    for split in splits:
        place = folder / f"{model.name}_{split.fold}"
        place.mkdir(parents=True, exist_ok=True)
        one = replace(run, model=model, fold=split.fold, trainer=replace(run.trainer, resume=True))
        found = one.train(frames, split, place, progress)
        checkpoint = Checkpoint.load(found.checkpoint)
        members.append(
            Member(f"fold {split.fold}", checkpoint.recipe, checkpoint.weights, _start(checkpoint, run))
        )
        trained.append(found)
    return TrainedFolds(tuple(members), tuple(trained))


def _start(checkpoint: Checkpoint, run: FoldRun) -> str:
    """Digest of the weights that a training began from."""
    noted = checkpoint.notes.get("start")
    return str(noted) if noted else weights_digest(initial_network(checkpoint.recipe, run.seed).state_dict())


def history_of(trained: Sequence[TrainedFold]) -> tuple[dict[str, float], ...]:
    """Average the measures of each epoch over the folds that trained so long.

    Parameters
    ----------
    trained : sequence of TrainedFold
        Trainings.

    Returns
    -------
    tuple of dict
        Measures of each epoch.
    """
    longest = max(len(one.history) for one in trained)
    epochs = []
    for epoch in range(longest):
        measures = [one.history[epoch] for one in trained if len(one.history) > epoch]
        names = dict.fromkeys(name for each in measures for name in each)
        values = {name: [each[name] for each in measures if name in each] for name in names}
        epochs.append({name: sum(found) / len(found) for name, found in values.items()})
    return tuple(epochs)
