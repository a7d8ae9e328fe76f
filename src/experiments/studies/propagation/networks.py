"""Where the masks of a job come from: the simulator's truth, a network trained on a configuration, or a file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from experiments.analysis.segmentation.fold_outcome import train_in_fold
from experiments.analysis.segmentation.fold_run import FoldRun, device_of, start_tags, training_metrics
from experiments.datasets.protocol import input_data, name_of, notes_of
from experiments.outcome import InputData, Progress

if TYPE_CHECKING:
    from experiments.datasets.protocol import DataSet
    from experiments.splits.group_splits import GroupSplits
    from models.training.settings import TrainerSettings
    from registration.phantom.scan import SimulatedSweep

# The configuration of the simulator's own masks, and the name of their network in tables.
REFERENCE = "reference"
NO_MODEL = ""
# The fold of a row that no fold trained.
NO_FOLD = -1


@dataclass(frozen=True)
class MaskSource:
    """What makes the masks of a job, and what its run has of that.

    Parameters
    ----------
    values_of : callable
        Masks of a simulated sweep's frames, or maps whose level of one half is their outline, shape (n, h, w).
    model : str
        Name of the network in tables.
    pictures : bool
        Whether the frames' pictures are needed.
    metrics : Mapping[str, float], optional
        How the training went.
    history : tuple of Mapping[str, float], optional
        Metrics of each epoch.
    tags : Mapping[str, str], optional
        Weights that the training started from.
    inputs : tuple of InputData, optional
        Data set that was trained on.
    notes : tuple of str, optional
        What a reader must know of the data that were trained on.
    """

    values_of: Callable[[SimulatedSweep], np.ndarray]
    model: str
    pictures: bool
    metrics: Mapping[str, float] = field(default_factory=dict)
    history: tuple[Mapping[str, float], ...] = ()
    tags: Mapping[str, str] = field(default_factory=dict)
    inputs: tuple[InputData, ...] = ()
    notes: tuple[str, ...] = ()


def reference() -> MaskSource:
    """Take the simulator's own masks.

    Returns
    -------
    MaskSource
        The true masks.
    """
    return MaskSource(lambda sweep: sweep.masks, NO_MODEL, pictures=False)


def of_file(path: Path, trainer: TrainerSettings) -> MaskSource:
    """Use a saved model, with its own thresholds and morphology.

    Parameters
    ----------
    path : Path
        Model file, or the checkpoint of a fold (``model.pt``).
    trainer : TrainerSettings
        Give the device and the number of threads.

    Returns
    -------
    MaskSource
        The model in use.
    """
    from models.model_file import SegmentationModel

    names = dict.fromkeys(member.recipe.name for member in SegmentationModel.load(path).members)
    return MaskSource(_segment(path, trainer), " + ".join(names), pictures=True)


def trained(
    one: FoldRun, dataset: DataSet, split: GroupSplits, workspace: Path, progress: Progress
) -> MaskSource:
    """Train a network in one fold of a data set.

    Leaves ``model.pt``, the divisions and the data set's notes in ``workspace``.

    Parameters
    ----------
    one : FoldRun
        Settings of the training, and the fold.
    dataset : DataSet
        Data set, in its configuration.
    split : GroupSplits
        Division of the groups into training, validation and test.
    workspace : Path
        Folder of the run in which result files are left.
    progress : Progress
        Receives notes and progress.

    Returns
    -------
    MaskSource
        The trained network in use.
    """
    fold, frames, own = train_in_fold(one, dataset, split, workspace, progress)
    return MaskSource(
        _segment(fold.checkpoint, one.trainer),
        one.model_name,
        pictures=True,
        metrics={**training_metrics(fold), "train_cases": float(len(own.train))},
        history=fold.history,
        tags={"dataset": name_of(dataset), **start_tags(fold)},
        inputs=(input_data(dataset, frames),),
        notes=notes_of(dataset),
    )


def _segment(path: Path, trainer: TrainerSettings) -> Callable[[SimulatedSweep], np.ndarray]:
    from models.predictor import Predictor
    from models.processor import fixed_threads

    predictor = Predictor.load(path, device=device_of(trainer.accelerator))

    def values_of(sweep: SimulatedSweep) -> np.ndarray:
        with fixed_threads(trainer.threads):
            found = predictor.soft_masks(sweep.sweep.images, sweep.sweep.calibration.spacing_mm)
        return np.asarray(found)

    return values_of
