"""What the variety of a data set, and not its size alone, does to segmentation: configurations of San Raffaele."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.analysis.segmentation.configurations import (
    CONFIGURATIONS,
    configuration_jobs,
    configured,
    names_of,
)
from experiments.analysis.segmentation.fold_outcome import fold_outcome
from experiments.analysis.segmentation.fold_run import (
    FoldRun,
    require_fitting_size,
    require_start,
)
from experiments.datasets.protocol import DataSet, require_root
from experiments.outcome import JobResult, Outcome, Progress
from experiments.splits.group_splits import GroupSplits
from experiments.studies.dataset_variability.report import summary_of

__all__ = ["CONFIGURATIONS", "check", "configured", "jobs", "run", "summarise"]

if TYPE_CHECKING:
    from models.networks.registry import NetworkRecipe
    from models.preprocessing.preprocessing import Preprocessing
    from models.training.augmentation import Augmentation
    from models.training.initialisation import Initialisation
    from models.training.losses import Loss
    from models.training.settings import TrainerSettings


def jobs(config: Mapping[str, Any]) -> list[dict[str, Any]]:
    """List one job for each configuration and fold, or for the fold that ``fold`` names.

    Parameters
    ----------
    config : Mapping[str, Any]
        Configuration of the sweep point.

    Returns
    -------
    list of dict
        What each job changes in the configuration.

    Raises
    ------
    InputError
        If a configuration is unknown, the data set has none, or the split has outer folds or is read from a file.
    """
    return configuration_jobs(config, names_of(config))


def check(
    *,
    dataset: DataSet,
    configurations: Sequence[str],
    model: NetworkRecipe,
    preprocessing: Preprocessing,
    init: Initialisation,
) -> None:
    """Check that the data set is there and has the configuration, and the network takes the image size and the start.

    Parameters
    ----------
    dataset : DataSet
        Data set.
    configurations : sequence of str
        Name of the one configuration of the job.
    model : NetworkRecipe
        Recipe of the network.
    preprocessing : Preprocessing
        Preprocessing of the images.
    init : Initialisation
        Weights to start from.

    Raises
    ------
    InputError
        If one of them does not fit.
    """
    require_fitting_size(model, preprocessing)
    own = configured(dataset, configurations)
    require_start(init, model, own)
    require_root(own)


def run(
    *,
    dataset: DataSet,
    configurations: Sequence[str],
    split: GroupSplits,
    model: NetworkRecipe,
    preprocessing: Preprocessing,
    trainer: TrainerSettings,
    augmentation: Augmentation,
    loss: Loss,
    init: Initialisation,
    fold: int,
    seed: int,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Train one fold of one configuration, and score its unseen cases and those of the common test subjects.

    Parameters
    ----------
    dataset : DataSet
        San Raffaele; its own ``subset`` and ``subsample_to`` give way to the configuration's.
    configurations : sequence of str
        Name of the one configuration of the job.
    split : GroupSplits
        Division of the groups outside the test into training, validation and unseen.
    model : NetworkRecipe
        Recipe of the network.
    preprocessing : Preprocessing
        Preprocessing of the images.
    trainer : TrainerSettings
        Settings of the training.
    augmentation : Augmentation
        Augmentation of the training images.
    loss : Loss
        Training loss.
    init : Initialisation
        Weights that all folds start from.
    fold : int
        Number of the fold.
    seed : int
        Seed of everything that is drawn at random.
    workspace : Path
        Folder of the run in which result files are left.
    progress : Progress
        Receives notes and progress.

    Returns
    -------
    Outcome
        Metrics, cases, training history, the table, training curves, overlays and findings.

    Raises
    ------
    InputError
        If the data set cannot be read or divided.
    """
    one = FoldRun(model, preprocessing, trainer, augmentation, loss, init, seed, fold)
    (name,) = configurations
    own = configured(dataset, configurations)
    found = fold_outcome(one, own, split, workspace, progress, configuration=name)
    return replace(found, tags={**found.tags, "configuration": name})


def summarise(results: list[JobResult]) -> Outcome:
    """Compare the configurations on the common test subjects, and show each on its own unseen cases.

    Parameters
    ----------
    results : list of JobResult
        Results of all jobs of the sweep.

    Returns
    -------
    Outcome
        Metrics, cases, tables, the figure and findings over all jobs.
    """
    return summary_of(results)
