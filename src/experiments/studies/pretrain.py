"""One network trained on whole data sets, from whose weights the folds of another data set start."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.analysis.segmentation.case_table import SMOKE
from experiments.analysis.segmentation.figures import training_curves
from experiments.analysis.segmentation.fold_run import (
    require_fitting_size,
    require_start,
    run_training,
    start_tags,
    training_metrics,
)
from experiments.datasets.protocol import (
    DataSet,
    input_data,
    label_of,
    name_of,
    notes_of,
    require_root,
    training_data,
    write_notes,
    write_report,
)
from experiments.errors import InputError
from experiments.files import write_text
from experiments.outcome import Outcome, Progress
from experiments.splits.group_partition import GroupedCases
from models.labelled_frames import LabelledFrames

if TYPE_CHECKING:
    from models.networks.registry import NetworkRecipe
    from models.preprocessing.preprocessing import Preprocessing
    from models.training.augmentation import Augmentation
    from models.training.fold import TrainedFold
    from models.training.initialisation import Initialisation
    from models.training.losses import Loss
    from models.training.settings import TrainerSettings
    from models.training.spec import FoldTraining

MIN_GROUPS = 2


def check(
    *,
    dataset: DataSet,
    also: DataSet | None,
    model: NetworkRecipe,
    preprocessing: Preprocessing,
    init: Initialisation,
    validation_parts: int,
) -> None:
    """Check that the data sets exist and that the network takes the image size and the weights to start from.

    Parameters
    ----------
    dataset : DataSet
        Data set.
    also : DataSet or None
        Second data set.
    model : NetworkRecipe
        Recipe of the network.
    preprocessing : Preprocessing
        Preprocessing of the images.
    init : Initialisation
        Weights to start from.
    validation_parts : int
        Number of parts of the groups, one of which is kept.

    Raises
    ------
    InputError
        If a setting is not as expected.
    """
    require_fitting_size(model, preprocessing)
    if validation_parts < 2:
        raise InputError(f"validation_parts: expected at least 2, received {validation_parts}")
    sets = _sets(dataset, also)
    for one in sets:
        require_root(one)
    if len(sets) == 2 and name_of(sets[0]) == name_of(sets[1]):
        raise InputError(
            f"also: expected a data set of another name than dataset, received {name_of(sets[0])!r} twice"
        )
    require_start(init, model, *sets)


def run(
    *,
    dataset: DataSet,
    also: DataSet | None,
    model: NetworkRecipe,
    preprocessing: Preprocessing,
    trainer: TrainerSettings,
    augmentation: Augmentation,
    loss: Loss,
    init: Initialisation,
    validation_parts: int,
    seed: int,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Train on all groups but those that choose the epoch.

    Leaves ``model.pt``, which ``init.path`` takes, ``pretraining.json`` (what it was trained on and for how
    long), the data sets' notes and the tables of what they left out in ``workspace``.

    Parameters
    ----------
    dataset : DataSet
        Data set.
    also : DataSet or None
        Second data set to train on together with the first.
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
        Weights to start from.
    validation_parts : int
        One part in so many of each data set's groups is kept to choose the epoch by.
    seed : int
        Seed of everything that is drawn at random.
    workspace : Path
        Folder of the run in which result files are left.
    progress : Progress
        Receives notes and progress.

    Returns
    -------
    Outcome
        Metrics, training history, training curves and findings.

    Raises
    ------
    InputError
        If a data set cannot be read or has a single group.
    """
    from models.training.spec import FoldTraining

    sets = _sets(dataset, also)
    progress.note(f"reading {' and '.join(map(name_of, sets))}")
    frames = [one() for one in sets]
    parts = [
        _divided(name_of(one), own, validation_parts, seed) for one, own in zip(sets, frames, strict=True)
    ]
    names = [name_of(one) for one in sets]
    training = FoldTraining(
        model=model,
        train=joined(names, [train for train, _ in parts]),
        validation=joined(names, [validation for _, validation in parts]),
        preprocessing=preprocessing,
        trainer=trainer,
        augmentation=augmentation,
        loss=loss,
        seed=seed,
        fold=0,
        initialisation=init,
        data=tuple(training_data(one, own) for one, own in zip(sets, frames, strict=True)),
    )
    trained = run_training(training, "pretraining", workspace, progress)
    write_notes(workspace, *sets)
    for one in sets:
        write_report(one, workspace)
    _write_record(workspace, training, trained)
    labels = [label_of(one, own) for one, own in zip(sets, frames, strict=True)]
    return _outcome(
        trained,
        f"{SMOKE if trainer.smoke else ''}{getattr(model, 'label', model.name)}",
        " and ".join(labels),
        training,
        inputs=tuple(input_data(one, own) for one, own in zip(sets, frames, strict=True)),
        notes=tuple(note for one in sets for note in notes_of(one)),
    )


def joined(names: Sequence[str], parts: Sequence[LabelledFrames]) -> LabelledFrames:
    """Join the frames of several data sets; cases and groups get the name of their data set where there are several.

    Parameters
    ----------
    names : sequence of str
        Names of the data sets.
    parts : sequence of LabelledFrames
        Frames of each.

    Returns
    -------
    LabelledFrames
        All frames; simulated if any part is.
    """
    if len(parts) == 1:
        return parts[0]
    pairs = list(zip(names, parts, strict=True))
    return LabelledFrames(
        images=tuple(image for part in parts for image in part.images),
        masks=tuple(mask for part in parts for mask in part.masks),
        case_ids=tuple(f"{name}/{case}" for name, part in pairs for case in part.case_ids),
        groups=tuple(f"{name}/{group}" for name, part in pairs for group in part.groups),
        spacing_mm=tuple(spacing for part in parts for spacing in part.spacing_mm),
        simulated=any(part.simulated for part in parts),
    )


def _sets(dataset: DataSet, also: DataSet | None) -> list[DataSet]:
    return [dataset] if also is None else [dataset, also]


def _divided(
    name: str, frames: LabelledFrames, parts: int, seed: int
) -> tuple[LabelledFrames, LabelledFrames]:
    """Frames to train on, and those of the groups that choose the epoch."""
    cases, every = GroupedCases.of(frames), np.arange(len(frames))
    if (count := cases.count_groups(every)) < MIN_GROUPS:
        raise InputError(
            f"{name}: expected at least {MIN_GROUPS} groups, one of them to choose the epoch by, received {count}"
        )
    kept = cases.stopping_part(every, parts, seed)
    return frames.subset(np.setdiff1d(every, kept)), frames.subset(kept)


def _write_record(workspace: Path, training: FoldTraining, trained: TrainedFold) -> None:
    from models.checkpoint import Checkpoint

    record: dict[str, Any] = dict(Checkpoint.load(trained.checkpoint).notes)
    record["training_data"] = [vars(each) for each in training.learnt_from]
    record |= {
        "epochs": len(trained.history),
        "cases": len(training.train),
        "validation_groups": sorted(set(training.validation.groups)),
    }
    write_text(workspace / "pretraining.json", json.dumps(record, indent=1))


def _outcome(
    trained: TrainedFold,
    model: str,
    label: str,
    training: FoldTraining,
    *,
    inputs: Any,
    notes: tuple[str, ...],
) -> Outcome:
    groups = len(set(training.validation.groups))
    found = (
        f"{model} trained on {len(training.train)} frames of {label} for {len(trained.history)} epochs: validation DSC "
        f"{trained.best_validation_dsc:.3f} on {groups} groups, epoch {trained.best_epoch + 1} kept."
    )
    use = "To start the folds of another data set from it: init=pretrained init.path=<this run's folder>/model.pt"
    return Outcome(
        metrics=training_metrics(trained),
        history=trained.history,
        figures={
            "training_curves": training_curves(trained.history, trained.best_epoch, f"{model} on {label}")
        },
        findings=(found, use, *notes),
        tags={
            "model": model,
            "dataset": label,
            "simulated": str(training.train.simulated).lower(),
            **start_tags(trained),
        },
        inputs=inputs,
    )
