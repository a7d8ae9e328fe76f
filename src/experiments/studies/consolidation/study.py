"""One model from the folds: averages, ensembles and a distilled network compared, calibrated, and certified."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments import files, registry
from experiments.analysis.consolidation.calibrations import CALIBRATIONS
from experiments.analysis.consolidation.certificate import NonInferiority
from experiments.analysis.consolidation.leaks import require_no_leaks
from experiments.analysis.consolidation.summary import (
    certificate_pages,
    consolidated_metrics,
    data_of,
    decisions,
    named_jobs,
    overview,
    pool,
)
from experiments.analysis.segmentation.case_table import smoke_note
from experiments.analysis.segmentation.fold_run import FoldRun, fold_jobs, require_fitting_size, require_start
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
    write_report,
)
from experiments.errors import InputError
from experiments.outcome import JobResult, Outcome, Progress
from experiments.splits.group_splits import GroupSplits

if TYPE_CHECKING:
    from experiments.studies.consolidation.job import Consolidated
    from models.labelled_frames import LabelledFrames
    from models.networks.registry import NetworkRecipe
    from models.postprocessing import PostprocessingGrid
    from models.preprocessing.preprocessing import Preprocessing
    from models.training.augmentation import Augmentation
    from models.training.distillation import Distillation
    from models.training.initialisation import Initialisation
    from models.training.losses import Loss
    from models.training.settings import TrainerSettings

NOT_NESTED = -1
# What the dashboard has columns for.
HEADLINE = (
    *("dsc_mean", "dsc_std", "dsc_ci_low", "dsc_ci_high", "hd95_mm_mean", "hd95_px_mean"),
    *("missed_rate", "false_alarm_rate", "certified", "training_s"),
)


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
    _require_parts(split)
    outer = list(
        dict.fromkeys(job.get("outer_fold") for job in fold_jobs(split, config.get("outer_fold"), None))
    )
    return [
        {"training_seed": seed} if number is None else {"training_seed": seed, "outer_fold": number}
        for seed in (seeds if asked is None else [asked])
        for number in outer
    ]


def _require_parts(split: GroupSplits) -> None:
    """Refuse a split without groups for choices or for scores, before any data is read."""
    selection = split.selection_share > 0 or bool(split.selection_groups)
    test = split.test_share > 0 or bool(split.test_groups) or split.outer_folds is not None
    if split.file is None and not (selection and test):
        raise InputError(
            "split: expected groups outside the folds for selection and for test (split=three_way or split=nested), "
            f"received none for {'selection' if not selection else 'test'}"
        )


def check(
    *,
    dataset: DataSet,
    model: NetworkRecipe,
    second: NetworkRecipe | None,
    preprocessing: Preprocessing,
    init: Initialisation,
    calibration: str,
) -> None:
    """Check that the networks take the image size and the weights to start from, and the calibration is known.

    Parameters
    ----------
    dataset : DataSet
        Data set.
    model : NetworkRecipe
        Recipe of the network.
    second : NetworkRecipe or None
        That of a second network.
    preprocessing : Preprocessing
        Preprocessing of the images.
    init : Initialisation
        Weights to start from.
    calibration : str
        Name of the calibration.

    Raises
    ------
    InputError
        If one does not fit.
    """
    require_fitting_size(model, preprocessing)
    require_start(init, model, dataset)
    if second is not None:
        require_start(init, second, dataset)
        require_fitting_size(second, preprocessing)
        if second == model:
            raise InputError("model@second: expected another network than model, received the same")
    if calibration not in CALIBRATIONS:
        raise InputError(f"calibration: expected one of {', '.join(CALIBRATIONS)}, received {calibration!r}")


def run(
    *,
    dataset: DataSet,
    split: GroupSplits,
    model: NetworkRecipe,
    second: NetworkRecipe | None,
    preprocessing: Preprocessing,
    trainer: TrainerSettings,
    augmentation: Augmentation,
    loss: Loss,
    init: Initialisation,
    postprocessing: PostprocessingGrid,
    calibration: str,
    max_false_alarm_rate: float | None,
    band_px: float,
    distilled: bool,
    distillation: Distillation,
    aligned: bool,
    statistics_cases: int | None,
    barrier_points: int,
    barrier_cases: int | None,
    margin: float,
    alpha: float,
    min_seeds: int,
    min_groups: int,
    outer_fold: int | None,
    training_seed: int,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Train the folds of one seed, make every choice on selection groups, then score all candidates on test groups.

    Leaves ``model.pt`` (the consolidated model), ``candidates/*.pt``, ``certificate.md``, ``splits.json`` and the data
    set's notes in ``workspace``.

    Parameters
    ----------
    dataset : DataSet
        Data set.
    split : GroupSplits
        Division of the groups into cross-validation, selection and test.
    model : NetworkRecipe
        Network of the folds.
    second : NetworkRecipe or None
        Second network, whose folds join the first's in the ensemble of networks; None for none.
    preprocessing : Preprocessing
        Preprocessing of the images.
    trainer : TrainerSettings
        Settings of the trainings. Finished trainings are always used again.
    augmentation : Augmentation
        Augmentation of the training images.
    loss : Loss
        Training loss.
    init : Initialisation
        Weights that all trainings start from.
    postprocessing : PostprocessingGrid
        Thresholds and smallest areas to choose from.
    calibration : str
        Calibration that thresholds are chosen behind.
    max_false_alarm_rate : float or None
        Largest share of false alarms on selection groups; None for no limit.
    band_px : float
        Half width of the band around the boundary in px of the network's size.
    distilled : bool
        Whether a network is trained on the ensemble's probabilities, with the budget of a fold.
    distillation : Distillation
        Loss of that training.
    aligned : bool
        Whether networks are aligned and repaired for one of the averages.
    statistics_cases : int or None
        Largest number of training cases that statistics of channels are estimated on; None for all.
    barrier_points : int
        Number of points on the line between two folds' networks.
    barrier_cases : int or None
        Largest number of selection cases that barriers are evaluated on; None for all.
    margin, alpha, min_seeds, min_groups
        As in ``NonInferiority``.
    outer_fold : int or None
        Number of the outer fold; None where the split is not nested.
    training_seed : int
        Seed of the trainings; images and division have ``seed``.
    workspace : Path
        Folder of the run in which result files are left.
    progress : Progress
        Receives notes and progress.

    Returns
    -------
    Outcome
        Metrics, rows, tables, figures and findings.

    Raises
    ------
    InputError
        If the data set cannot be read or divided, or a group or an image is in two parts.
    """
    from experiments.analysis.consolidation.evaluation import ChoiceSettings
    from experiments.studies.consolidation.job import ConsolidationJob, JobSettings

    progress.note(f"reading {name_of(dataset)}")
    frames = dataset()
    splits = split(frames, **outside_groups(dataset)).of_outer_fold(outer_fold)
    require_no_leaks(frames, splits)
    splits.write(workspace / "splits.json")
    write_report(dataset, workspace)
    write_notes(workspace, dataset)
    one = FoldRun(model, preprocessing, trainer, augmentation, loss, init, training_seed, 0, outer_fold)
    choice = ChoiceSettings(calibration, postprocessing, max_false_alarm_rate, band_px)
    settings = JobSettings(
        second,
        choice,
        distillation if distilled else None,
        aligned,
        barrier_points,
        barrier_cases,
        statistics_cases,
    )
    scratch = workspace / "scratch"
    try:
        done = ConsolidationJob(one, dataset, frames, splits, settings, scratch, progress)()
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    rule = NonInferiority(margin, alpha, min_seeds, min_groups)
    return _outcome(done, one, dataset, frames, rule, calibration, workspace)


def _outcome(
    done: Consolidated,
    one: FoldRun,
    dataset: DataSet,
    frames: LabelledFrames,
    rule: NonInferiority,
    calibration: str,
    workspace: Path,
) -> Outcome:
    """Rows with what they are of, the decision of this job alone, and the files of the model."""
    import pandas as pd

    record = training_data(dataset, frames)
    about = {
        "network": _network(one),
        "dataset": reported_name(dataset),
        "simulated": frames.simulated,
        "data_digest": record.digest,
        "data_licence": record.licence,
        "seed": one.seed,
        "outer_fold": NOT_NESTED if one.outer_fold is None else one.outer_fold,
    }
    cases = pd.DataFrame([{**row, **about} for row in done.rows])
    decided = decisions(cases, rule)
    (known,) = data_of(cases)
    done.write(workspace, decided[0], known)
    files.write_text(workspace / "certificate.md", certificate_pages(decided, {"data": [known]}))
    outcome = overview(cases, decided, calibration)
    return Outcome(
        metrics={**outcome.metrics, "training_s": done.training_s, "evaluation_s": done.evaluation_s},
        cases=cases,
        history=done.history,
        tables=outcome.tables,
        figures=outcome.figures,
        findings=(
            *outcome.findings,
            *done.notes,
            *smoke_note(cases.assign(model=cases["network"])),
            *notes_of(dataset),
        ),
        tags={
            "model": one.model_name,
            "dataset": name_of(dataset),
            "simulated": str(frames.simulated).lower(),
            "consolidated": decided[0].certificate.consolidated,
        },
        inputs=(input_data(dataset, frames),),
    )


def _network(run: FoldRun) -> str:
    """Name of the network with what its folds start from, where that is trained."""
    learnt_from = getattr(run.initialisation, "trained_on", ())
    start = ", ".join(data.label for data in learnt_from)
    return f"{run.model_name} from {start}" if start else run.model_name


def over_repeats(results: list[JobResult]) -> dict[str, float]:
    """Score the consolidated model of one network on one data set, over seeds and outer folds.

    Parameters
    ----------
    results : list of JobResult
        Results of the seeds and outer folds.

    Returns
    -------
    dict
        Scalars by the name of the metric.
    """
    config, cases = results[0].config, pool(results)
    rule = NonInferiority(config["margin"], config["alpha"], config["min_seeds"], config["min_groups"])
    return consolidated_metrics(cases, decisions(cases, rule))


def summarise(results: list[JobResult]) -> Outcome:
    """Decide over all seeds, and pool tables, figures and findings over outer folds and seeds.

    Parameters
    ----------
    results : list of JobResult
        Results of all jobs of the sweep.

    Returns
    -------
    Outcome
        Metrics, rows, tables, figures, findings and files: certificate and models.
    """
    from experiments.studies.consolidation.model_files import model_writers

    config = results[0].config
    cases = pool(results)
    rule = NonInferiority(config["margin"], config["alpha"], config["min_seeds"], config["min_groups"])
    decided = decisions(cases, rule)
    outcome = overview(cases, decided, str(config["calibration"]))
    about = {"data": data_of(cases)}
    return replace(
        outcome,
        findings=(
            *outcome.findings,
            *smoke_note(cases.assign(model=cases["network"])),
            *read_notes(result.workspace for result in results),
        ),
        files={"certificate.md": lambda path: files.write_text(path, certificate_pages(decided, about))}
        | model_writers(results, named_jobs(results), decided, about),
    )
