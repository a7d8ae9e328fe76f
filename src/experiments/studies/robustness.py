"""How often a rigid method finds a known pose again, over perturbations, overlap, noise and outliers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.errors import InputError
from experiments.outcome import CellResult, Outcome, Progress
from experiments.processes import process_pool
from experiments.statistics import summary
from experiments.studies.registration_inputs import one_method
from experiments.studies.robustness_problem import Problem, covered_targets, read_problem
from experiments.studies.robustness_report import describe, figures, success_metrics, table
from experiments.studies.robustness_trial import RobustnessTrial
from registration import errors as registration_errors
from registration.perturbation import Perturbation, Piece

if TYPE_CHECKING:
    import pandas as pd

SUMMARISED = (
    "rmse_mm",
    "tre_mm",
    "tre_max_mm",
    "tre_covered_mm",
    "rotation_error_deg",
    "translation_error_mm",
    "runtime_s",
)


def cells(config: Mapping[str, Any]) -> list[dict[str, Any]]:
    """One cell for each method at each overlap."""
    methods, overlaps = config.get("rigid"), config.get("overlaps")
    if not isinstance(methods, Mapping) or not methods:
        raise InputError(f"rigid: expected at least one method, received {methods!r}")
    if not isinstance(overlaps, Sequence) or isinstance(overlaps, str) or not overlaps:
        raise InputError(f"overlaps: expected a list of shares, received {overlaps!r}")
    return [
        {"rigid": {name: settings}, "overlaps": [overlap]}
        for overlap in overlaps
        for name, settings in methods.items()
    ]


def check(
    *,
    target: str | None,
    moving: str | None,
    moving_truth: str | None,
    centerline: str | None,
    rigid: Mapping[str, Any],
    overlaps: Sequence[float],
    piece: str,
    trials: int,
    workers: int,
) -> None:
    """Raise InputError for files and settings that allow no trial at all."""
    one_method(rigid)
    _piece(overlaps, piece)
    _require_count("trials", trials)
    _require_count("workers", workers)
    read_problem(target, moving, moving_truth, centerline)


def run(
    *,
    target: str | None,
    moving: str | None,
    moving_truth: str | None,
    centerline: str | None,
    rigid: Mapping[str, Any],
    perturbation: Perturbation,
    overlaps: Sequence[float],
    piece: str,
    trials: int,
    workers: int,
    seed: int,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Solve ``trials`` perturbed problems by one method at one overlap.

    Every method of a seed meets the same problems. A method that raises on a trial has failed it: the row stays, with
    infinite errors and the reason. Raises InputError for files and settings that allow no trial at all.
    """
    del workspace
    _require_count("trials", trials)
    _require_count("workers", workers)
    name, method = one_method(rigid)
    part = _piece(overlaps, piece)
    problem = read_problem(target, moving, moving_truth, centerline)
    task = RobustnessTrial(
        name=name,
        method=method,
        perturbation=perturbation,
        piece=part,
        moving=problem.moving,
        fixed=problem.fixed,
        true_fixed_T_moving=problem.fixed_T_moving,
        targets_mm=problem.targets_mm,
        covered=covered_targets(problem, part),
        seed=seed,
    )
    rows = progress.track(_solved(task, trials, workers), f"{name}, overlap {part.share:g}", trials)
    return _outcome(list(rows), problem)


def summarise(cells: list[CellResult]) -> Outcome:
    """Set all methods and overlaps side by side: one table, success against angle, RMSE against TRE."""
    import pandas as pd

    known = [cell.cases for cell in cells if cell.cases is not None and len(cell.cases)]
    if not known:
        return Outcome(findings=("No job has trials to summarise.",))
    cases = pd.concat(known, ignore_index=True)
    return Outcome(
        cases=cases, tables={"robustness": table(cases)}, figures=figures(cases), findings=describe(cases)
    )


def _piece(overlaps: Sequence[float], place: str) -> Piece:
    if len(overlaps) != 1:
        raise InputError(f"overlaps: expected one overlap a job, received {len(overlaps)}")
    try:
        return Piece(overlaps[0], place)
    except registration_errors.InputError as refusal:
        raise InputError(f"overlaps and piece: {refusal}") from refusal


def _require_count(name: str, value: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        raise InputError(f"{name}: expected a whole number of at least 1, received {value!r}")


def _solved(task: RobustnessTrial, trials: int, workers: int) -> Iterator[dict[str, Any]]:
    """The rows in order of trial, from this process or from several."""
    if workers == 1:
        yield from map(task, range(trials))
        return
    with process_pool(min(workers, trials)) as pool:
        yield from pool.map(task, range(trials), chunksize=max(trials // (8 * workers), 1))


def _outcome(rows: list[dict[str, Any]], problem: Problem) -> Outcome:
    import pandas as pd

    cases: pd.DataFrame = pd.DataFrame(rows)
    metrics = success_metrics(cases)
    for name in SUMMARISED:
        metrics |= summary(name, cases[name].tolist())
    return Outcome(
        metrics=metrics,
        cases=cases,
        tables={"robustness": table(cases)},
        figures=figures(cases),
        findings=describe(cases),
        tags={"tre_targets": problem.target_kind, "tre_targets_n": str(len(problem.targets_mm))},
        inputs=problem.inputs,
    )
