"""How well a network segments the vessel in groups of frames that it has not seen, fold by fold."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments import registry
from experiments.analysis.segmentation.case_table import pool, smoke_note
from experiments.analysis.segmentation.comparison import compare_models
from experiments.analysis.segmentation.comparison_findings import comparison_metrics, describe_comparison
from experiments.analysis.segmentation.figures import spread
from experiments.analysis.segmentation.findings import describe
from experiments.analysis.segmentation.fold_outcome import fold_outcome
from experiments.analysis.segmentation.fold_run import (
    FoldRun,
    fold_jobs,
    require_fitting_size,
    require_start,
)
from experiments.analysis.segmentation.measured import measured
from experiments.analysis.segmentation.outside import outside_table
from experiments.analysis.segmentation.summary import pooled_metrics
from experiments.analysis.segmentation.tables import tables
from experiments.datasets.protocol import DataSet, read_notes, require_root
from experiments.outcome import JobResult, Outcome, Progress
from experiments.splits.group_splits import GroupSplits

if TYPE_CHECKING:
    from models.networks.registry import NetworkRecipe
    from models.preprocessing.preprocessing import Preprocessing
    from models.training.augmentation import Augmentation
    from models.training.initialisation import Initialisation
    from models.training.losses import Loss
    from models.training.settings import TrainerSettings

# What the dashboard has columns for.
__all__ = ["HEADLINE", "check", "jobs", "measured", "over_repeats", "run", "summarise"]

HEADLINE = (
    *("dsc_mean", "dsc_std", "dsc_ci_low", "dsc_ci_high", "hd95_mm_mean", "hd95_px_mean"),
    *("missed_rate", "false_alarm_rate", "training_s"),
)


def jobs(config: Mapping[str, Any]) -> list[dict[str, Any]]:
    """List one job for each fold, or for those that ``outer_fold`` and ``fold`` name.

    A data set whose folder does not exist is refused here, once, before any fold starts.

    Parameters
    ----------
    config : Mapping[str, Any]
        Configuration of the sweep point.

    Returns
    -------
    list of dict
        What each job changes in the configuration.
    """
    split = registry.build(config["split"], "split")
    found = fold_jobs(split, config.get("outer_fold"), config.get("fold"))
    require_root(registry.build(config["dataset"], "dataset"))
    return [dict(job) for job in found]


def check(
    *, dataset: DataSet, model: NetworkRecipe, preprocessing: Preprocessing, init: Initialisation
) -> None:
    """Check that the network takes the image size and the weights to start from.

    Parameters
    ----------
    dataset : DataSet
        Data set.
    model : NetworkRecipe
        Recipe of the network.
    preprocessing : Preprocessing
        Preprocessing of the images.
    init : Initialisation
        Weights to start from.

    Raises
    ------
    InputError
        If the network does not take the image size, or the start is of another architecture or has learnt from the
        data set.
    """
    require_fitting_size(model, preprocessing)
    require_start(init, model, dataset)


def run(
    *,
    dataset: DataSet,
    split: GroupSplits,
    model: NetworkRecipe,
    preprocessing: Preprocessing,
    trainer: TrainerSettings,
    augmentation: Augmentation,
    loss: Loss,
    init: Initialisation,
    outer_fold: int | None,
    fold: int,
    seed: int,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Train one fold and score the cases that it has not seen at their native resolution.

    Cases outside all folds are scored as well; their rows say so in the column ``part``.

    Leaves ``model.pt`` (the weights of the best epoch), ``predictions.zip`` (logits and masks of all scored
    cases, for ``StoredPredictions``), ``split.json`` (this fold), ``splits.json`` (all folds, as
    ``split.file`` takes them), the data set's notes and the tables of what it left out in
    ``workspace``.

    Parameters
    ----------
    dataset : DataSet
        Data set.
    split : GroupSplits
        Division of the groups into training, validation and test.
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
    outer_fold : int or None
        Number of the outer fold; None where the split is not nested.
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
        If the data set cannot be read or divided, or the network does not take the image size.
    """
    one = FoldRun(model, preprocessing, trainer, augmentation, loss, init, seed, fold, outer_fold)
    return fold_outcome(one, dataset, split, workspace, progress)


def over_repeats(results: list[JobResult]) -> dict[str, float]:
    """Summarise the scores of folds and seeds of one model on one data set, each case once.

    Parameters
    ----------
    results : list of JobResult
        Results of the folds and seeds.

    Returns
    -------
    dict
        Scalars by the name of the metric.
    """
    return pooled_metrics(pool(results))


def summarise(results: list[JobResult]) -> Outcome:
    """Pool the cases of all jobs, with intervals, every pair of models compared and the spread.

    Cases outside all folds stand in a table of their own and in no pooled number.

    Parameters
    ----------
    results : list of JobResult
        Results of all jobs of the sweep.

    Returns
    -------
    Outcome
        Metrics, cases, tables, the figure and findings over all jobs.
    """
    cases = pool(results)
    compared = compare_models(cases)
    notes = read_notes(result.workspace for result in results)
    return Outcome(
        metrics={**pooled_metrics(cases), **comparison_metrics(compared)},
        cases=cases,
        tables={**tables(cases, compared), **outside_table(results)},
        figures={"spread": spread(cases)},
        findings=(*describe(cases), *describe_comparison(compared), *smoke_note(cases), *notes),
    )
