"""How often a rigid method finds a known pose again, over rotations, overlap, noise, outliers and lost frames."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.errors import InputError, require_count
from experiments.inputs.surfaces import one_method
from experiments.outcome import JobResult, Outcome, Progress
from experiments.paths import PathSetting
from experiments.provenance import COMMIT_TAG, environment_tags
from experiments.statistics import summary
from experiments.studies.robustness.design import conditions, job_changes, one_piece
from experiments.studies.robustness.findings import describe
from experiments.studies.robustness.metrics import rate_metrics
from experiments.studies.robustness.pooling import pooled
from experiments.studies.robustness.problem import Problem, covered_targets, read_problem
from experiments.studies.robustness.rate_figures import figures
from experiments.studies.robustness.tables import tables
from experiments.studies.robustness.trial import RobustnessTrial
from experiments.studies.robustness.trial_store import KeptRows, solved_rows
from registration.perturbation.perturbation import Perturbation

if TYPE_CHECKING:
    import pandas as pd

SUMMARISED = (
    "rmse_mm",
    "tre_mm",
    "tre_max_mm",
    "tre_covered_mm",
    "rotation_error_deg",
    "translation_error_mm",
    "roll_error_deg",
    "slide_error_mm",
    "runtime_s",
)

# What the dashboard has columns for.
HEADLINE = (
    *("success_rate", "success_tre_rate", "success_tre_rate_low", "success_tre_rate_high", "acceptance_rate"),
    *(
        "success_tre_accepted_rate",
        "rmse_mm_median",
        "tre_mm_median",
        "tre_mm_p95",
        "rotation_error_deg_median",
    ),
    *("runtime_s_median", "trials", "trials_failed"),
)


def jobs(config: Mapping[str, Any]) -> list[dict[str, Any]]:
    """List one job for each method on each piece of each target, and for each method at each factor's levels.

    Parameters
    ----------
    config : Mapping[str, Any]
        Configuration of the sweep point.

    Returns
    -------
    list of dict
        What each job changes in the configuration.
    """
    return job_changes(config)


def check(
    *,
    target: PathSetting | None,
    moving: PathSetting | None,
    moving_truth: PathSetting | None,
    target_centerline: PathSetting | None,
    hand_centerlines: bool,
    rigid: Mapping[str, Any],
    perturbation: Perturbation,
    overlaps: Sequence[float],
    places: Sequence[str],
    rotations: Sequence[str] | None,
    factors: Mapping[str, Sequence[float]] | None,
    trials: int,
    workers: int,
) -> None:
    """Check that files and settings allow trials.

    Parameters
    ----------
    target : PathSetting or None
        File of the fixed surface in mm.
    moving : PathSetting or None
        File of a moving cloud; None to draw it from the target.
    moving_truth : PathSetting or None
        JSON file with the true ``fixed_T_moving``, required with ``moving``; None without.
    target_centerline : PathSetting or None
        VTP file on which the error is measured; None for points of the target's surface.
    hand_centerlines : bool
        True to give methods the true centerline and the moving piece's part of it.
    rigid : Mapping[str, Any]
        Settings of exactly one rigid registration method by its name.
    perturbation : Perturbation
        How trials are disturbed.
    overlaps : sequence of float
        One share of the vessel's extent that the moving cloud covers.
    places : sequence of str
        One place of the piece along the vessel.
    rotations : sequence of str or None
        Kinds of rotation; None for the perturbation's own.
    factors : Mapping[str, Sequence[float]] or None
        Levels by the name of a factor; None or empty for the rotations.
    trials : int
        Number of trials of each level and, where the perturbation has bins of angles, of each bin.
    workers : int
        Number of processes; the results do not depend on it.

    Raises
    ------
    InputError
        If files and settings allow no trial at all.
    """
    one_method(rigid)
    one_piece(overlaps, places)
    conditions(perturbation, rotations, factors, trials)
    require_count("workers", workers)
    _problem(target, moving, moving_truth, target_centerline, hand_centerlines)


def run(
    *,
    target: PathSetting | None,
    moving: PathSetting | None,
    moving_truth: PathSetting | None,
    target_centerline: PathSetting | None,
    hand_centerlines: bool,
    rigid: Mapping[str, Any],
    perturbation: Perturbation,
    overlaps: Sequence[float],
    places: Sequence[str],
    rotations: Sequence[str] | None,
    factors: Mapping[str, Sequence[float]] | None,
    trials: int,
    workers: int,
    seed: int,
    resume: bool,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Solve the perturbed problems of one job by one method.

    These are all rotations of a piece, or all levels of a factor. Every method of a seed meets the same
    problems. A method that raises on a trial has failed it: the row stays, with infinite errors and the
    reason. Finished trials are kept next to the results until the job is done.

    Parameters
    ----------
    target : PathSetting or None
        File of the fixed surface in mm.
    moving : PathSetting or None
        File of a moving cloud; None to draw it from the target.
    moving_truth : PathSetting or None
        JSON file with the true ``fixed_T_moving``, required with ``moving``; None without.
    target_centerline : PathSetting or None
        VTP file on which the error is measured; None for points of the target's surface.
    hand_centerlines : bool
        True to give methods the true centerline and the moving piece's part of it.
    rigid : Mapping[str, Any]
        Settings of exactly one rigid registration method by its name.
    perturbation : Perturbation
        How trials are disturbed.
    overlaps : sequence of float
        One share of the vessel's extent that the moving cloud covers.
    places : sequence of str
        One place of the piece along the vessel.
    rotations : sequence of str or None
        Kinds of rotation; None for the perturbation's own.
    factors : Mapping[str, Sequence[float]] or None
        Levels by the name of a factor; None or empty for the rotations.
    trials : int
        Number of trials of each level and, where the perturbation has bins of angles, of each bin.
    workers : int
        Number of processes; the results do not depend on it.
    seed : int
        Seed of everything that is drawn at random.
    resume : bool
        True to resume an interrupted job after its finished trials.
    workspace : Path
        Folder of the run; not used.
    progress : Progress
        Receives notes and progress.

    Returns
    -------
    Outcome
        Metrics, a row for each trial, tables, figures and findings.

    Raises
    ------
    InputError
        If files and settings allow no trial at all.
    """
    del workspace
    require_count("workers", workers)
    name, method = one_method(rigid)
    piece = one_piece(overlaps, places)
    design = conditions(perturbation, rotations, factors, trials)
    problem = _problem(target, moving, moving_truth, target_centerline, hand_centerlines)
    task = RobustnessTrial(
        anatomy=Path(str(target)).stem,
        name=name,
        method=method,
        conditions=design,
        piece=piece,
        moving=problem.moving,
        fixed=problem.fixed,
        true_fixed_T_moving=problem.fixed_T_moving,
        targets_mm=problem.targets_mm,
        covered=covered_targets(problem, piece),
        hand_centerlines=hand_centerlines,
        seed=seed,
    )
    keys = [(number, trial) for number, each in enumerate(design) for trial in range(each.trials)]
    identity = (
        name,
        method,
        [each.perturbation for each in design],
        piece,
        problem.digests,
        hand_centerlines,
        seed,
        # Rows of other code are not gone on with.
        environment_tags().get(COMMIT_TAG, ""),
    )
    rows = solved_rows(task, keys, workers=workers, kept=KeptRows.of(identity), resume=resume)
    return _outcome(list(progress.track(rows, f"{name}, overlap {piece.share:g}", len(keys))), problem)


def parameters(config: Mapping[str, Any]) -> dict[str, Any]:
    """Name what a job's trials are of, for the dashboard's columns.

    Parameters
    ----------
    config : Mapping[str, Any]
        Configuration of the job.

    Returns
    -------
    dict
        Values by name; of a factor with several levels all of them.
    """
    disturbed, factors = dict(config["perturbation"]), dict(config.get("factors") or {})
    return {
        "rigid": ", ".join(config["rigid"]),
        "target": config.get("target"),
        "overlap": config["overlaps"],
        # The whole vessel has no place.
        "place": config["places"] if config["overlaps"] != [1.0] else None,
        "rotation": config.get("rotations") or disturbed.get("rotation"),
        "translation_mm": factors.get("translation_mm", disturbed.get("translation_max_mm")),
        "noise_mm": factors.get("noise_mm", disturbed.get("noise_mm")),
        **{
            name: factors.get(name, disturbed.get(name) or None)
            for name in ("outlier_share", "missing_share")
        },
        "trials": config["trials"],
    }


def over_repeats(results: list[JobResult]) -> dict[str, float]:
    """Count the trials of all seeds of one method on one problem.

    Parameters
    ----------
    results : list of JobResult
        Results of the seeds.

    Returns
    -------
    dict
        Rates with their intervals and summaries of errors.
    """
    return trial_metrics(pooled(results))


def summarise(results: list[JobResult]) -> Outcome:
    """Compare all methods, pieces and factors.

    Parameters
    ----------
    results : list of JobResult
        Results of all jobs of the sweep.

    Returns
    -------
    Outcome
        Cases, tables, figures and findings over all jobs.
    """
    kept = [result for result in results if result.cases is not None and len(result.cases)]
    if not kept:
        return Outcome(findings=("No job has trials to summarise.",))
    return shown(pooled(kept))


def shown(cases: pd.DataFrame) -> Outcome:
    """Make the tables, figures and findings of any trials of this study.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of the trials.

    Returns
    -------
    Outcome
        Cases, tables, figures and findings.
    """
    return Outcome(cases=cases, tables=tables(cases), figures=figures(cases), findings=describe(cases))


def _problem(
    target: PathSetting | None,
    moving: PathSetting | None,
    moving_truth: PathSetting | None,
    target_centerline: PathSetting | None,
    hand_centerlines: bool,
) -> Problem:
    if hand_centerlines and target_centerline is None:
        raise InputError(
            "hand_centerlines: expected a target_centerline to hand to the methods, received none"
        )
    return read_problem(target, moving, moving_truth, target_centerline)


def trial_metrics(cases: pd.DataFrame) -> dict[str, float]:
    """Summarise trials of one method: rates with their intervals, errors and run time.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of the trials.

    Returns
    -------
    dict
        Scalars by name; rates over no trial are absent.
    """
    # A rate over no trial, as that of acceptance where a method does not judge, is no failure: it is no metric.
    metrics = {name: value for name, value in rate_metrics(cases).items() if value == value}
    for name in SUMMARISED:
        metrics |= summary(name, cases[name].tolist())
    return metrics


def _outcome(rows: list[dict[str, Any]], problem: Problem) -> Outcome:
    import pandas as pd

    cases: pd.DataFrame = pd.DataFrame(rows)
    return dataclasses.replace(
        shown(cases),
        metrics=trial_metrics(cases),
        tags={"tre_targets": problem.target_kind, "tre_targets_n": str(len(problem.targets_mm))},
        inputs=problem.inputs,
    )
