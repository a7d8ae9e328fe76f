"""One fold trained and used: what the studies that train networks have in common."""

from __future__ import annotations

import statistics
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.analysis.segmentation.case_table import OUT_OF_FOLD, SMOKE
from experiments.analysis.segmentation.stored_predictions import PredictionWriter
from experiments.datasets.protocol import DataSet, name_of, reported_name, training_data
from experiments.errors import InputError
from experiments.outcome import Progress
from experiments.paths import project_root
from experiments.splits.group_splits import GroupSplits
from experiments.splits.split import Split
from models.labelled_frames import LabelledFrames

if TYPE_CHECKING:
    import pandas as pd

    from models.networks.registry import NetworkRecipe
    from models.preprocessing.preprocessing import Preprocessing
    from models.training.augmentation import Augmentation
    from models.training.fold import TrainedFold
    from models.training.initialisation import Initialisation
    from models.training.losses import Loss
    from models.training.settings import TrainerSettings
    from models.training.spec import FoldTraining


def require_fitting_size(model: NetworkRecipe, preprocessing: Preprocessing) -> None:
    """Refuse an image size that a network does not take.

    Parameters
    ----------
    model : NetworkRecipe
        The network; its ``multiple`` divides both sides of an image.
    preprocessing : Preprocessing
        Gives the side of the square image, in px.

    Raises
    ------
    models.errors.InputError
        If the side is no multiple of the network's.
    """
    from models.networks.blocks import require_size

    require_size(preprocessing.image_size_px, preprocessing.image_size_px, model.multiple)


def require_start(init: Initialisation, model: NetworkRecipe, *datasets: DataSet) -> None:
    """Refuse weights to start from that are of another architecture, or that have learnt from a data set by name.

    A data set of another name and the same content is found once its frames are read.

    Parameters
    ----------
    init : Initialisation
        Weights to start from.
    model : NetworkRecipe
        Network to train.
    *datasets : DataSet
        Data sets that are trained on or scored.

    Raises
    ------
    models.errors.InputError
        If the weights don't fit or have seen one of the data sets.
    """
    from models.training.training_data import TrainingData

    init.require_fit(model)
    init.require_unseen([TrainingData(name_of(dataset), "not read yet") for dataset in datasets])


def start_tags(trained: TrainedFold) -> dict[str, str]:
    """Name the weights that a training started from, as tags of its run.

    Parameters
    ----------
    trained : TrainedFold
        Training result.

    Returns
    -------
    dict
        ``init`` (how they were chosen), ``start_source`` (what they are) and ``start`` (their digest).
    """
    from models.checkpoint import Checkpoint

    notes = Checkpoint.load(trained.checkpoint).notes
    return {name: str(notes[name]) for name in ("init", "start_source", "start")}


def fold_jobs(split: GroupSplits, outer_fold: object, fold: object) -> list[dict[str, int]]:
    """List the jobs of a study that trains in folds.

    Parameters
    ----------
    split : GroupSplits
        The split with its folds.
    outer_fold : object
        Number of an outer fold; None for all of them.
    fold : object
        Number of a fold; None for all of them.

    Returns
    -------
    list of dict
        Settings ``fold``, and ``outer_fold`` if the split is nested, of each job.

    Raises
    ------
    InputError
        If there is no such fold, or an outer fold is named and the split has none.
    """
    pairs = split.pairs()
    nested = any(outer is not None for outer, _ in pairs)
    if not nested and outer_fold is not None:
        raise InputError(
            f"outer_fold: expected null, as the split has no outer folds, received {outer_fold!r}"
        )
    for place, (name, asked) in enumerate((("outer_fold", outer_fold), ("fold", fold))):
        numbers = sorted({number for pair in pairs if (number := pair[place]) is not None})
        if asked is not None and (isinstance(asked, bool) or asked not in numbers):
            raise InputError(f"{name}: expected 0 to {numbers[-1]}, or null for all, received {asked!r}")
        pairs = tuple(pair for pair in pairs if asked is None or pair[place] == asked)
    return [{"fold": f} if o is None else {"outer_fold": o, "fold": f} for o, f in pairs]


@dataclass(frozen=True)
class FoldRun:
    """Settings that train and use a network in one fold, and its place among the folds.

    Parameters
    ----------
    model : NetworkRecipe
        Network to train.
    preprocessing : Preprocessing
        Preprocessing of the images.
    trainer : TrainerSettings
        Settings of the training.
    augmentation : Augmentation
        Augmentation of the training images.
    loss : Loss
        Loss to minimise.
    initialisation : Initialisation
        Weights that all folds start from.
    seed : int
        Seed of every random choice of the training.
    fold : int
        Number of the fold.
    outer_fold : int or None, optional
        Number of the outer fold; None for a split that is not nested.
    """

    model: NetworkRecipe
    preprocessing: Preprocessing
    trainer: TrainerSettings
    augmentation: Augmentation
    loss: Loss
    initialisation: Initialisation
    seed: int
    fold: int
    outer_fold: int | None = None

    @property
    def model_name(self) -> str:
        """Name of the network in tables; that of a smoke-trained network begins with ``smoke-trained``."""
        name = str(getattr(self.model, "label", self.model.name))
        return f"{SMOKE}{name}" if self.trainer.smoke else name

    def training(self, dataset: DataSet, frames: LabelledFrames, split: Split) -> FoldTraining:
        """Specify the training on the fold's ``train`` and ``validation`` cases.

        Parameters
        ----------
        dataset : DataSet
            Data set, for its name and licence.
        frames : LabelledFrames
            All of its frames.
        split : Split
            Split into parts for this fold.

        Returns
        -------
        FoldTraining
            The training.
        """
        from models.training.spec import FoldTraining

        return FoldTraining(
            model=self.model,
            train=split.of(frames, "train"),
            validation=split.of(frames, "validation"),
            preprocessing=self.preprocessing,
            trainer=self.trainer,
            augmentation=self.augmentation,
            loss=self.loss,
            seed=self.seed,
            fold=self.fold,
            initialisation=self.initialisation,
            data=(training_data(dataset, frames),),
        )

    def train(
        self, dataset: DataSet, frames: LabelledFrames, split: Split, workspace: Path, progress: Progress
    ) -> TrainedFold:
        """Train on the fold's ``train`` and ``validation`` cases.

        Parameters
        ----------
        dataset : DataSet
            Data set, for its name and licence.
        frames : LabelledFrames
            Labelled frames of the data set.
        split : Split
            Split into parts for this fold.
        workspace : Path
            Folder of the job; ``model.pt`` is left in it.
        progress : Progress
            Shows the epochs.

        Returns
        -------
        TrainedFold
            Training result with the path of the checkpoint.
        """
        return run_training(self.training(dataset, frames, split), split.place, workspace, progress)

    def score(
        self,
        trained: TrainedFold,
        dataset: DataSet,
        frames: LabelledFrames,
        progress: Progress,
        *,
        part: str = OUT_OF_FOLD,
        keep: PredictionWriter | None = None,
        **about: Any,
    ) -> pd.DataFrame:
        """Predict frames with the trained network and score the predictions at native resolution.

        Parameters
        ----------
        trained : TrainedFold
            Training result of this fold.
        dataset : DataSet
            Data set of ``frames``, for its name.
        frames : LabelledFrames
            Frames to predict, with their reference masks.
        progress : Progress
            Shows the cases.
        part : str, optional
            Part of the split that the frames are: ``out_of_fold``, or one outside all folds.
        keep : PredictionWriter or None, optional
            Takes the predictions; None keeps none.
        **about : Any
            Values of further columns, the same for all rows.

        Returns
        -------
        pandas.DataFrame
            Scores, one row for each frame.
        """
        import pandas as pd

        from models.checkpoint import Checkpoint
        from models.evaluation import case_row, predict_logits
        from models.processor import fixed_threads

        network = Checkpoint.load(trained.checkpoint).network()
        place = {case: index for index, case in enumerate(frames.case_ids)}
        nested = {} if self.outer_fold is None else {"outer_fold": self.outer_fold}
        known = {**nested, "fold": self.fold, "model": self.model_name, "dataset": reported_name(dataset)}
        known |= {"seed": self.seed, "part": part, **about}
        device, batch_size = device_of(self.trainer.accelerator), self.trainer.batch_size
        rows: dict[int, dict[str, Any]] = {}
        with fixed_threads(self.trainer.threads):
            found = predict_logits(network, self.preprocessing, frames, batch_size, device)
            title = f"fold {self.fold}: cases" + ("" if part == OUT_OF_FOLD else f" of {part}")
            for each in progress.track(found, title, len(frames)):
                index = place[each.case_id]
                rows[index] = case_row(frames, index, each.mask, known)
                if keep is not None:
                    keep.add(each, frames.groups[index], part)
        return pd.DataFrame([rows[index] for index in sorted(rows)])


def run_training(training: FoldTraining, place: str, workspace: Path, progress: Progress) -> TrainedFold:
    """Train, and show the epochs.

    The state from which an interrupted training is resumed lies in the project's cache, because the workspace is
    deleted when the job fails.

    Parameters
    ----------
    training : FoldTraining
        The training.
    place : str
        Which one it is, before the bar.
    workspace : Path
        Folder of the job; ``model.pt`` is left in it.
    progress : Progress
        Shows the epochs.

    Returns
    -------
    TrainedFold
        Training result with the path of the checkpoint.
    """
    from models.training.fold import train_fold

    state = project_root() / ".cache" / "training" / training.fingerprint[:16]
    most = training.trainer.max_epochs + training.trainer.extend_epochs
    epochs = _bar(progress, most, f"{place}: epochs")

    def advance(_: Mapping[str, float]) -> None:
        next(epochs, None)

    def waits() -> None:
        progress.note(f"{place}: waiting for another process at the same training")

    trained = train_fold(
        training, directory=workspace, state_directory=state, on_epoch=advance, on_wait=waits
    )
    for _ in epochs:
        pass
    return trained


def training_metrics(trained: TrainedFold) -> dict[str, float]:
    """Summarise how a training went, as scalars.

    Parameters
    ----------
    trained : TrainedFold
        Training result.

    Returns
    -------
    dict
        Best validation DSC and its epoch, number of epochs, time in s, images per s of the median epoch, and
        the largest peak memory of any epoch in MB.
    """
    return {
        "validation_dsc_best": trained.best_validation_dsc,
        "best_epoch": float(trained.best_epoch),
        "epochs": float(len(trained.history)),
        "training_s": trained.runtime_s,
        "images_per_s": float(statistics.median(epoch["images_per_s"] for epoch in trained.history)),
        "peak_memory_mb": max(epoch["peak_memory_mb"] for epoch in trained.history),
    }


def _bar(progress: Progress, most: int, description: str) -> Iterator[int]:
    # A bar advances when the next item is asked for, so the first is asked for before the work begins.
    epochs = iter(progress.track(range(most), description, most))
    next(epochs)
    return epochs


def device_of(accelerator: str) -> str:
    """Name the device that networks are used on.

    Parameters
    ----------
    accelerator : str
        Accelerator of the trainer's settings.

    Returns
    -------
    str
        ``cuda`` if there is a GPU and the settings allow it, else ``cpu``.
    """
    import torch

    return "cuda" if accelerator != "cpu" and torch.cuda.is_available() else "cpu"
