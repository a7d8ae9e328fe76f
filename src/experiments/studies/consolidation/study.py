"""One model from the folds: averages, ensembles and a distilled network compared, calibrated, and certified."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments import files, registry
from experiments.analysis.consolidation.calibrations import CALIBRATIONS
from experiments.analysis.consolidation.certificate import NonInferiority
from experiments.analysis.consolidation.leaks import require_no_leaks
from experiments.analysis.consolidation.summary import (
    certificate_pages,
    decisions,
    overview,
    pool,
)
from experiments.analysis.segmentation.case_table import smoke_note
from experiments.analysis.segmentation.fold_run import FoldRun, fold_jobs, require_fitting_size
from experiments.datasets.protocol import (
    DataSet,
    input_data,
    name_of,
    notes_of,
    outside_groups,
    read_notes,
    reported_name,
    require_root,
    write_notes,
    write_report,
)
from experiments.errors import InputError
from experiments.outcome import JobResult, Outcome, Progress
from experiments.splits.group_splits import GroupSplits

if TYPE_CHECKING:
    from models.networks.registry import NetworkRecipe
    from models.postprocessing import PostprocessingGrid
    from models.preprocessing.preprocessing import Preprocessing
    from models.training.augmentation import Augmentation
    from models.training.losses import Loss
    from models.training.settings import TrainerSettings

NOT_NESTED = -1


def jobs(config: Mapping[str, Any]) -> list[dict[str, Any]]:
    """List one job for each seed of the trainings and each outer fold, or for those that are named.

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
        If there are no seeds, one is named twice, or the named seed or outer fold is none of them.
    """
    require_root(registry.build(config["dataset"], "dataset"))
    seeds = list(config["seeds"])
    if not seeds or len(set(seeds)) != len(seeds):
        raise InputError(f"seeds: expected different whole numbers, received {seeds}")
    asked = config.get("training_seed")
    if asked is not None and asked not in seeds:
        raise InputError(f"training_seed: expected one of seeds {seeds}, or null for all, received {asked!r}")
    split = registry.build(config["split"], "split")
    outer = list(dict.fromkeys(job.get("outer_fold") for job in fold_jobs(split, config.get("outer_fold"), None)))
    return [
        {"training_seed": seed} if number is None else {"training_seed": seed, "outer_fold": number}
        for seed in (seeds if asked is None else [asked])
        for number in outer
    ]


def check(
    *, model: NetworkRecipe, second: NetworkRecipe | None, preprocessing: Preprocessing, calibration: str
) -> None:
    """Check that the networks take the image size and the calibration is known.

    Parameters
    ----------
    model : NetworkRecipe
        Recipe of the network.
    second : NetworkRecipe or None
        That of a second network.
    preprocessing : Preprocessing
        Preprocessing of the images.
    calibration : str
        Name of the calibration.

    Raises
    ------
    InputError
        If one does not fit.
    """
    require_fitting_size(model, preprocessing)
    if second is not None:
        require_fitting_size(second, preprocessing)
        if second == model:
            raise InputError("model@second: expected another network than model, received the same")
    if calibration not in CALIBRATIONS:
        raise InputError(f"calibration: expected one of {', '.join(CALIBRATIONS)}, received {calibration!r}")
