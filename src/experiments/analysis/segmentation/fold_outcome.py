"""One fold from the frames of a data set to the outcome of a job, as the studies of segmentation share it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.analysis.segmentation.case_table import OUT_OF_FOLD, in_part, smoke_note
from experiments.analysis.segmentation.figures import overlays, training_curves
from experiments.analysis.segmentation.findings import describe
from experiments.analysis.segmentation.fold_run import FoldRun, start_tags, training_metrics
from experiments.analysis.segmentation.outside import OUTSIDE, outside_metrics
from experiments.analysis.segmentation.stored_predictions import FILE, StoredMasks, StoredPredictions, writing
from experiments.analysis.segmentation.summary import pooled_metrics
from experiments.analysis.segmentation.tables import table
from experiments.datasets.protocol import (
    DataSet,
    input_data,
    name_of,
    notes_of,
    outside_groups,
    write_notes,
    write_report,
)
from experiments.outcome import Outcome, Progress
from experiments.splits.group_splits import GroupSplits
from experiments.splits.split import Split

if TYPE_CHECKING:
    import pandas as pd

    from models.labelled_frames import LabelledFrames
    from models.training.fold import TrainedFold


def fold_outcome(
    one: FoldRun, dataset: DataSet, split: GroupSplits, workspace: Path, progress: Progress, **about: Any
) -> Outcome:
    """Train one fold and score the cases that it has not seen at their native resolution.

    Cases outside all folds are scored as well; their rows say so in the column ``part``. Leaves ``model.pt`` (the
    weights of the epoch that is kept), ``predictions.zip`` (logits and masks of all scored cases, for
    ``StoredPredictions``), ``split.json`` (this fold), ``splits.json`` (all folds), the data set's notes and the
    tables of what it left out in ``workspace``.

    Parameters
    ----------
    one : FoldRun
        Settings of the training, and the fold.
    dataset : DataSet
        Data set.
    split : GroupSplits
        Division of the groups into training, validation and test.
    workspace : Path
        Folder of the run in which result files are left.
    progress : Progress
        Receives notes and progress.
    **about : Any
        Values of further columns, the same for all rows.

    Returns
    -------
    Outcome
        Metrics, cases, training history, the table, training curves, overlays and findings.

    Raises
    ------
    InputError
        If the data set cannot be read or divided.
    """
    trained, frames, own = train_in_fold(one, dataset, split, workspace, progress)
    name = name_of(dataset)
    every = _scored(one, trained, dataset, frames, own, workspace, progress, about)
    cases, masks = in_part(every), StoredMasks(StoredPredictions.open(workspace / FILE))
    found, notes = describe(cases), notes_of(dataset)
    return Outcome(
        metrics={
            **pooled_metrics(cases),
            **training_metrics(trained),
            "train_cases": float(len(own.train)),
            **outside_metrics(every),
        },
        cases=every,
        history=trained.history,
        tables={"segmentation": table(cases)},
        figures={
            "training_curves": training_curves(trained.history, trained.best_epoch, found[0]),
            **overlays(own.of(frames, "test"), masks, cases),
        },
        findings=(*found, *smoke_note(cases), *notes),
        tags={
            "model": one.model_name,
            "dataset": name,
            "simulated": str(frames.simulated).lower(),
            **start_tags(trained),
            **({"notes": " ".join(notes)} if notes else {}),
        },
        inputs=(input_data(dataset, frames),),
    )


def train_in_fold(
    one: FoldRun, dataset: DataSet, split: GroupSplits, workspace: Path, progress: Progress
) -> tuple[TrainedFold, LabelledFrames, Split]:
    """Read a data set, divide it and train one fold.

    Leaves ``model.pt``, ``split.json``, ``splits.json``, the data set's notes and the tables of what it left out in
    ``workspace``.

    Parameters
    ----------
    one : FoldRun
        Settings of the training, and the fold.
    dataset : DataSet
        Data set.
    split : GroupSplits
        Division of the groups into training, validation and test.
    workspace : Path
        Folder of the run in which result files are left.
    progress : Progress
        Receives notes and progress.

    Returns
    -------
    trained : TrainedFold
        Training result with the path of the checkpoint.
    frames : LabelledFrames
        All frames of the data set.
    own : Split
        Division of the frames in this fold.

    Raises
    ------
    InputError
        If the data set cannot be read or divided.
    """
    progress.note(f"reading {name_of(dataset)}")
    frames = dataset()
    splits = split(frames, **outside_groups(dataset))
    splits.write(workspace / "splits.json")
    own = splits.fold(one.fold, one.outer_fold)
    own.write(workspace / "split.json")
    write_report(dataset, workspace)
    write_notes(workspace, dataset)
    return one.train(dataset, frames, own, workspace, progress), frames, own


def _scored(
    one: FoldRun,
    trained: TrainedFold,
    dataset: DataSet,
    frames: LabelledFrames,
    own: Split,
    workspace: Path,
    progress: Progress,
    columns: dict[str, Any],
) -> pd.DataFrame:
    """Rows of the cases that the fold leaves out and of those outside all folds; their predictions are kept."""
    import pandas as pd

    parts = {OUT_OF_FOLD: "test", **{part: part for part in OUTSIDE if getattr(own, part)}}
    about: dict[str, Any] = {
        "model": one.model_name,
        "dataset": name_of(dataset),
        "seed": one.seed,
        "fold": one.fold,
        "outer_fold": one.outer_fold,
    }
    with writing(workspace / FILE, one.preprocessing, **about) as keep:
        rows = [
            one.score(trained, dataset, own.of(frames, side), progress, part=part, keep=keep, **columns)
            for part, side in parts.items()
        ]
    return pd.concat(rows, ignore_index=True)
