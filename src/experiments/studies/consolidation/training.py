"""The trainings of a job: the folds of one or two networks, and a network distilled from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from experiments.analysis.consolidation.candidates import DISTILLED
from experiments.analysis.segmentation.fold_run import FoldRun, run_training
from experiments.datasets.protocol import DataSet
from experiments.outcome import Progress
from experiments.splits.split_set import SplitSet
from models.array_types import Float
from models.averaging import Member
from models.checkpoint import Checkpoint
from models.labelled_frames import LabelledFrames

if TYPE_CHECKING:
    import numpy as np

    from models.networks.registry import NetworkRecipe
    from models.training.distillation import Distillation
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
    dataset: DataSet,
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
    dataset : DataSet
        Data set, for its name and licence.
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
        found = one.train(dataset, frames, split, place, progress)
        checkpoint = Checkpoint.load(found.checkpoint)
        members.append(
            Member(
                f"fold {split.fold}", checkpoint.recipe, checkpoint.weights, str(checkpoint.notes["start"])
            )
        )
        trained.append(found)
    return TrainedFolds(tuple(members), tuple(trained))


def cross_validation(frames: LabelledFrames, splits: SplitSet) -> LabelledFrames:
    """Take the cases that a network of all folds is trained on: all but those that stop the first fold's training.

    Parameters
    ----------
    frames : LabelledFrames
        All cases.
    splits : SplitSet
        The folds.

    Returns
    -------
    LabelledFrames
        Cases of the first fold's ``train`` and ``test``.
    """
    first = splits.splits[0]
    place = {case: index for index, case in enumerate(frames.case_ids)}
    return frames.subset(place[case] for case in (*first.train, *first.test))


def distil(
    run: FoldRun,
    dataset: DataSet,
    frames: LabelledFrames,
    splits: SplitSet,
    targets: Float[np.ndarray, "n s s"],
    loss: Distillation,
    folder: Path,
    progress: Progress,
) -> tuple[Member, TrainedFold]:
    """Train one network on an ensemble's probabilities, with the budget and the start of a fold.

    Parameters
    ----------
    run : FoldRun
        Settings of the trainings.
    dataset : DataSet
        Data set, for its name and licence.
    frames : LabelledFrames
        All cases.
    splits : SplitSet
        The folds. Training stops by the validation cases of the first.
    targets : ndarray of float, shape (n, s, s)
        Probabilities of the ensemble on ``cross_validation(frames, splits)``, at the network's size.
    loss : Distillation
        Loss against the probabilities.
    folder : Path
        Folder for the checkpoint.
    progress : Progress
        Shows the epochs.

    Returns
    -------
    member : Member
        The network.
    trained : TrainedFold
        How its training went.
    """
    # A fold of its own number, so that its shuffling and augmentation are those of no other.
    one = replace(run, fold=len(splits), trainer=replace(run.trainer, resume=True))
    training = replace(
        one.training(dataset, frames, splits.splits[0]),
        train=cross_validation(frames, splits),
        targets=targets,
        loss=loss,
    )
    place = folder / "distilled"
    place.mkdir(parents=True, exist_ok=True)
    trained = run_training(training, "distilled network", place, progress)
    checkpoint = Checkpoint.load(trained.checkpoint)
    return Member(DISTILLED, checkpoint.recipe, checkpoint.weights, str(checkpoint.notes["start"])), trained


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
