"""What a network trained on one data set is worth on another: each fold scored on the unseen cases of both."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments import registry
from experiments.analysis.segmentation.case_table import place_of, pool, smoke_note
from experiments.analysis.segmentation.figures import training_curves
from experiments.analysis.segmentation.fold_run import (
    FoldRun,
    fold_jobs,
    require_fitting_size,
    require_start,
    start_tags,
    training_metrics,
)
from experiments.analysis.segmentation.summary import bounded_summary
from experiments.datasets.protocol import (
    DataSet,
    input_data,
    name_of,
    notes_of,
    outside_groups,
    read_notes,
    reported_name,
    require_root,
    training_data,
    write_notes,
)
from experiments.errors import InputError
from experiments.outcome import JobResult, Outcome, Progress
from experiments.splits.group_splits import GroupSplits
from experiments.studies.domain_transfer.transfer_table import describe_transfer, transfer_map, transfer_table

if TYPE_CHECKING:
    import pandas as pd

    from models.labelled_frames import LabelledFrames
    from models.networks.registry import NetworkRecipe
    from models.preprocessing.preprocessing import Preprocessing
    from models.training.augmentation import Augmentation
    from models.training.initialisation import Initialisation
    from models.training.losses import Loss
    from models.training.settings import TrainerSettings

DOMAINS = ("first", "second")
OTHER = "other_"
SHOWN = ("dsc_mean", "dsc_std", "hd95_mm_mean", "hd95_px_mean", "false_alarm_rate")
# What the dashboard has columns for: the data set that a network was trained on, and the other one.
HEADLINE = (*SHOWN, *(f"{OTHER}{name}" for name in SHOWN), "training_s")


def jobs(config: Mapping[str, Any]) -> list[dict[str, Any]]:
    """List one job for each data set to train on and each fold, or for those that are named.

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
        If a data set is missing, the split differs between data sets, or ``train_on`` is unknown.
    """
    for domain in DOMAINS:
        if not isinstance(config[domain], Mapping):
            raise InputError(
                f"{domain}: expected a data set, as dataset@{domain}=phantom gives it, received {config[domain]!r}"
            )
    split = registry.build(config["split"], "split")
    if split.outer_folds is not None or split.file is not None:
        raise InputError("split: expected folds of both data sets alike, received outer_folds or a file")
    asked = config.get("train_on")
    if asked is not None and asked not in DOMAINS:
        raise InputError(f"train_on: expected first, second, or null for both, received {asked!r}")
    return [
        {"train_on": domain, **job}
        for domain in (DOMAINS if asked is None else (asked,))
        for job in fold_jobs(split, None, config.get("fold"))
    ]


def check(
    *,
    first: DataSet,
    second: DataSet,
    model: NetworkRecipe,
    preprocessing: Preprocessing,
    init: Initialisation,
) -> None:
    """Check that both data sets exist and differ, and that the image size fits.

    Parameters
    ----------
    first, second : DataSet
        Data set to compare.
    model : NetworkRecipe
        Recipe of the network.
    preprocessing : Preprocessing
        Preprocessing of the images.
    init : Initialisation
        Weights to start from.

    Raises
    ------
    InputError
        If a data set does not exist, both have one name, the network does not take the image size, or the start is
        of another architecture or has learnt from one of the data sets.
    """
    require_fitting_size(model, preprocessing)
    require_start(init, model, first, second)
    for place, dataset in (("first", first), ("second", second)):
        with _at(place):
            require_root(dataset)
    if name_of(first) == name_of(second):
        raise InputError(
            f"second: expected a data set of another name than first, received {name_of(second)!r} twice"
        )


@contextmanager
def _at(place: str) -> Iterator[None]:
    """Name a data set's settings by their place here: there is no ``dataset.root`` to pass, but a ``first.root``."""
    try:
        yield
    except InputError as refusal:
        raise InputError(re.sub(r"\bdataset\.(?=\w+=)", f"{place}.", str(refusal))) from refusal


def run(
    *,
    first: DataSet,
    second: DataSet,
    split: GroupSplits,
    model: NetworkRecipe,
    preprocessing: Preprocessing,
    trainer: TrainerSettings,
    augmentation: Augmentation,
    loss: Loss,
    init: Initialisation,
    train_on: str,
    fold: int,
    seed: int,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Train one fold of one data set and score that fold's unseen cases of both.

    Over all folds, every case of both data sets is scored once by networks of either, so that the table's
    columns are about the same cases. Leaves ``model.pt`` and ``split.json`` in ``workspace``.

    Parameters
    ----------
    first, second : DataSet
        Data set to compare.
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
    train_on : str
        ``first`` or ``second``: the data set to train on.
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
        Metrics, cases, training history, the table of transfer, training curves and findings.
    """
    import pandas as pd

    sets = {"first": first, "second": second}
    progress.note(f"reading {name_of(first)} and {name_of(second)}")
    frames = {domain: _read(domain, dataset) for domain, dataset in sets.items()}
    folds = {
        domain: split(frames[domain], **outside_groups(dataset)).fold(fold)
        for domain, dataset in sets.items()
    }
    folds[train_on].write(workspace / "split.json")
    write_notes(workspace, *sets.values())
    init.require_unseen([training_data(dataset, frames[domain]) for domain, dataset in sets.items()])
    one = FoldRun(model, preprocessing, trainer, augmentation, loss, init, seed, fold)
    trained = one.train(sets[train_on], frames[train_on], folds[train_on], workspace, progress)
    source: dict[str, Any] = {
        "train_dataset": reported_name(sets[train_on]),
        "train_simulated": frames[train_on].simulated,
    }
    cases = pd.concat(
        [
            one.score(trained, dataset, folds[domain].of(frames[domain], "test"), progress, **source)
            for domain, dataset in sets.items()
        ],
        ignore_index=True,
    )
    title = f"{one.model_name} on {source['train_dataset']}"
    return Outcome(
        metrics={**domain_metrics(cases), **training_metrics(trained)},
        cases=cases,
        history=trained.history,
        tables={"transfer": transfer_table(cases)},
        figures={"training_curves": training_curves(trained.history, trained.best_epoch, title)},
        findings=smoke_note(cases) + tuple(note for dataset in sets.values() for note in notes_of(dataset)),
        tags={
            "model": one.model_name,
            "train_dataset": str(source["train_dataset"]),
            **start_tags(trained),
        },
        inputs=tuple(input_data(dataset, frames[domain]) for domain, dataset in sets.items()),
    )


def _read(domain: str, dataset: DataSet) -> LabelledFrames:
    with _at(domain):
        return dataset()


def parameters(config: Mapping[str, Any]) -> dict[str, Any]:
    """Name the data sets of a job, for the dashboard's columns.

    Parameters
    ----------
    config : Mapping[str, Any]
        Configuration of the job.

    Returns
    -------
    dict
        Values by name.
    """
    own = str(config["train_on"])
    sets = {domain: registry.build(config[domain], domain) for domain in DOMAINS}
    other = next(domain for domain in DOMAINS if domain != own)
    return {"dataset": name_of(sets[own]), "other_dataset": name_of(sets[other])}


def over_repeats(results: list[JobResult]) -> dict[str, float]:
    """Summarise the scores of all folds of a network that was trained on one data set, on either.

    Parameters
    ----------
    results : list of JobResult
        Results of the folds.

    Returns
    -------
    dict
        Scalars by the name of the metric.
    """
    return domain_metrics(pool(results, factors=("train_on",)))


def domain_metrics(cases: pd.DataFrame) -> dict[str, float]:
    """Summarise the scores of one network on the data set that it was trained on, and on the other.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of both data sets.

    Returns
    -------
    dict
        Scalars by the name of the metric; those of the other data set begin with ``other_``.
    """
    own = cases["dataset"] == cases["train_dataset"]
    other = bounded_summary(cases[~own]) if (~own).any() else {}
    return {
        **(bounded_summary(cases[own]) if own.any() else {}),
        **{f"{OTHER}{name}": value for name, value in other.items()},
    }


def summarise(results: list[JobResult]) -> Outcome:
    """Tabulate and draw train and test domain over all folds, and what training on the other domain costs.

    Parameters
    ----------
    results : list of JobResult
        Results of all jobs of the sweep.

    Returns
    -------
    Outcome
        Metrics, cases, table, figure and findings over all jobs.
    """
    cases = pool(results, factors=("train_on",))
    transfer = transfer_table(cases)
    several = len(set(transfer["model"])) > 1
    metrics = {}
    for row in transfer.to_dict("records"):
        place = f"{place_of(row['trained_on'])}_to_{place_of(row['tested_on'])}"
        metrics[f"{row['model']}/dsc_mean/{place}" if several else f"dsc_mean/{place}"] = float(
            row["dsc_mean"]
        )
    return Outcome(
        metrics=metrics,
        cases=cases,
        tables={"transfer": transfer},
        figures={"transfer": transfer_map(transfer)} if len(transfer) else {},
        findings=(
            *describe_transfer(cases),
            *smoke_note(cases),
            *read_notes(result.workspace for result in results),
        ),
    )
