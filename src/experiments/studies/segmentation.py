"""How well a network segments the vessel in groups of frames that it has not seen, fold by fold."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments import registry
from experiments.analysis.segmentation.case_table import pool, smoke_note
from experiments.analysis.segmentation.comparison import compare_models
from experiments.analysis.segmentation.comparison_findings import comparison_metrics, describe_comparison
from experiments.analysis.segmentation.figures import overlays, spread, training_curves
from experiments.analysis.segmentation.findings import describe
from experiments.analysis.segmentation.fold_run import (
    FoldRun,
    fold_jobs,
    require_fitting_size,
    training_metrics,
)
from experiments.analysis.segmentation.summary import pooled_metrics
from experiments.analysis.segmentation.tables import table, tables
from experiments.datasets.protocol import (
    DataSet,
    input_data,
    name_of,
    notes_of,
    outside_groups,
    read_notes,
    require_root,
    write_notes,
    write_report,
)
from experiments.outcome import JobResult, Outcome, Progress
from experiments.splits.group_splits import GroupSplits

if TYPE_CHECKING:
    from models.networks.registry import NetworkRecipe
    from models.preprocessing.preprocessing import Preprocessing
    from models.training.augmentation import Augmentation
    from models.training.losses import Loss
    from models.training.settings import TrainerSettings


def jobs(config: Mapping[str, Any]) -> list[dict[str, Any]]:
    """One job for each fold, or for those that ``outer_fold`` and ``fold`` name.

    A data set whose folder is not there is refused here, once, before any fold starts.
    """
    split = registry.build(config["split"], "split")
    found = fold_jobs(split, config.get("outer_fold"), config.get("fold"))
    require_root(registry.build(config["dataset"], "dataset"))
    return [dict(job) for job in found]


def check(*, model: NetworkRecipe, preprocessing: Preprocessing) -> None:
    """Raise InputError for an image size that the network doesn't take."""
    require_fitting_size(model, preprocessing)


def run(
    *,
    dataset: DataSet,
    split: GroupSplits,
    model: NetworkRecipe,
    preprocessing: Preprocessing,
    trainer: TrainerSettings,
    augmentation: Augmentation,
    loss: Loss,
    outer_fold: int | None,
    fold: int,
    seed: int,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Train one fold and score the cases that it has not seen at their native resolution.

    Leaves ``model.pt`` (the weights of the best epoch), ``split.json`` (this fold), ``splits.json`` (all folds, as
    ``split.file`` takes them), the data set's notes and the tables of what it left out in ``workspace``. Raises
    InputError for a data set that can't be read or divided, or a network that doesn't take the image size.
    """
    name = name_of(dataset)
    progress.note(f"reading {name}")
    frames = dataset()
    splits = split(frames, **outside_groups(dataset))
    splits.write(workspace / "splits.json")
    own = splits.fold(fold, outer_fold)
    own.write(workspace / "split.json")
    write_report(dataset, workspace)
    write_notes(workspace, dataset)
    one = FoldRun(model, preprocessing, trainer, augmentation, loss, seed, fold, outer_fold)
    trained = one.train(frames, own, workspace, progress)
    test = own.of(frames, "test")
    cases, predictions = one.score(trained, dataset, test, progress)
    found, notes = describe(cases), notes_of(dataset)
    return Outcome(
        metrics={**pooled_metrics(cases), **training_metrics(trained)},
        cases=cases,
        history=trained.history,
        tables={"segmentation": table(cases)},
        figures={
            "training_curves": training_curves(trained.history, trained.best_epoch, found[0]),
            **overlays(test, predictions, cases),
        },
        findings=(*found, *smoke_note(cases), *notes),
        tags={
            "model": one.model_name,
            "dataset": name,
            "simulated": str(frames.simulated).lower(),
            **({"notes": " ".join(notes)} if notes else {}),
        },
        inputs=(input_data(dataset, frames),),
    )


def summarise(results: list[JobResult]) -> Outcome:
    """Pool the cases of all jobs: tables with intervals, every pair of models compared, the spread, sentences."""
    cases = pool(results)
    compared = compare_models(cases)
    notes = read_notes(result.workspace for result in results)
    return Outcome(
        metrics={**pooled_metrics(cases), **comparison_metrics(compared)},
        cases=cases,
        tables=tables(cases, compared),
        figures={"spread": spread(cases)},
        findings=(*describe(cases), *describe_comparison(compared), *smoke_note(cases), *notes),
    )
