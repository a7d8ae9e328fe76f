"""Arteries against veins, and one district of the body against both together: Mus-V."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments import registry
from experiments.analysis.segmentation.fold_outcome import fold_outcome
from experiments.analysis.segmentation.fold_run import (
    FoldRun,
    fold_jobs,
    require_fitting_size,
    require_start,
)
from experiments.datasets.musv import LABELS, MusV
from experiments.datasets.musv_subjects import ALL, DISTRICTS
from experiments.datasets.protocol import DataSet, require_root
from experiments.errors import InputError
from experiments.outcome import JobResult, Outcome, Progress
from experiments.splits.group_splits import GroupSplits
from experiments.studies.vessel_type.report import AGGREGATED, LEAKAGE, summary_of

if TYPE_CHECKING:
    from models.networks.registry import NetworkRecipe
    from models.preprocessing.preprocessing import Preprocessing
    from models.training.augmentation import Augmentation
    from models.training.initialisation import Initialisation
    from models.training.losses import Loss
    from models.training.settings import TrainerSettings


def jobs(config: Mapping[str, Any]) -> list[dict[str, Any]]:
    """List one job for each vessel, district and fold, or for the fold that ``fold`` names.

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
        If vessels or districts are no lists, or the split has outer folds or is read from a file.
    """
    vessels, districts = (_names(config, name) for name in ("vessels", "districts"))
    split = registry.build(config["split"], "split")
    if split.outer_folds is not None or split.file is not None:
        raise InputError("split: expected folds of every district alike, received outer_folds or a file")
    return [
        {"vessels": [vessel], "districts": [district], **job}
        for vessel in vessels
        for district in districts
        for job in fold_jobs(split, None, config["fold"])
    ]


def _names(config: Mapping[str, Any], setting: str) -> Sequence[str]:
    names = config.get(setting)
    if not isinstance(names, Sequence) or isinstance(names, str) or not names:
        raise InputError(f"{setting}: expected a list of {setting}, received {names!r}")
    return names


def check(
    *,
    dataset: DataSet,
    vessels: Sequence[str],
    districts: Sequence[str],
    model: NetworkRecipe,
    preprocessing: Preprocessing,
    init: Initialisation,
) -> None:
    """Check that the data set is there and has vessel and district, and the network takes the image size and the start.

    Parameters
    ----------
    dataset : DataSet
        Data set.
    vessels : sequence of str
        Name of the one vessel of the job.
    districts : sequence of str
        Name of the one district of the job, or ``aggregated``.
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
    own = part_of(dataset, vessels, districts)
    require_start(init, model, own)
    require_root(own)


def run(
    *,
    dataset: DataSet,
    vessels: Sequence[str],
    districts: Sequence[str],
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
    """Train one fold on one vessel in one district or in both, and score its unseen cases.

    Parameters
    ----------
    dataset : DataSet
        Mus-V; its own ``target`` and ``district`` give way to the job's.
    vessels : sequence of str
        Name of the one vessel of the job.
    districts : sequence of str
        Name of the one district of the job, or ``aggregated``.
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
    own = part_of(dataset, vessels, districts)
    about = {"vessel": vessels[0], "trained_on": districts[0]}
    known = "" if own.simulate or own.subjects is not None else LEAKAGE
    found = fold_outcome(one, own, split, workspace, progress, **about, data=known)
    assert found.cases is not None
    shown = own.districts([str(case) for case in found.cases["case_id"]])
    return replace(found, cases=found.cases.assign(district=shown), tags={**found.tags, **about})


def part_of(dataset: DataSet, vessels: Sequence[str], districts: Sequence[str]) -> MusV:
    """Give the data set with one vessel, in one district or in both.

    Parameters
    ----------
    dataset : DataSet
        Mus-V with any vessel and district.
    vessels : sequence of str
        Name of one vessel.
    districts : sequence of str
        Name of one district, or ``aggregated``.

    Returns
    -------
    MusV
        The data set.

    Raises
    ------
    InputError
        If it is another data set, there is no such vessel or district, or no table says the districts.
    """
    if not isinstance(dataset, MusV):
        raise InputError(f"dataset: expected musv_artery or musv_vein, received {dataset!r}")
    for name, given, known in (
        ("vessels", vessels, tuple(LABELS)),
        ("districts", districts, (*DISTRICTS, AGGREGATED)),
    ):
        if len(given) != 1 or given[0] not in known:
            raise InputError(f"{name}: expected each one of {', '.join(known)}, received {list(given)}")
    district = ALL if districts[0] == AGGREGATED else districts[0]
    if district != ALL and dataset.subjects is None and not dataset.simulate:
        raise InputError(
            f"districts: expected [{AGGREGATED}] where no table says what a sequence shows, received {districts[0]!r}; "
            "pass dataset.subjects=<CSV with columns seq, volunteer, district>"
        )
    return replace(dataset, target=vessels[0], district=district)


def summarise(results: list[JobResult]) -> Outcome:
    """Compare arteries with veins, and training in one district with training in both.

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
