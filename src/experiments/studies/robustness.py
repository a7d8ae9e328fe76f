"""How often a rigid method finds a known pose again, over perturbations, overlap, noise and outliers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.errors import InputError
from experiments.outcome import CellResult, Outcome, Progress
from experiments.statistics import summary
from experiments.studies.registration_inputs import (
    one_method,
    read_mm,
    read_pose,
    refuse_metres,
    require_path,
)
from experiments.studies.robustness_report import describe, figures, success_metrics, table
from experiments.studies.robustness_trial import RobustnessTrial
from registration import errors as registration_errors
from registration.geometry import Mesh
from registration.geometry_io import read_centerline
from registration.metrics import Surface
from registration.perturbation import Perturbation, Piece

if TYPE_CHECKING:
    import pandas as pd

# At most this many points carry the target registration error.
MOST_TARGETS = 500
# Drawn once for every study, so that all runs on a surface share their targets.
TARGET_SEED = 20250


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
    name, method = one_method(rigid)
    if len(overlaps) != 1:
        raise InputError(f"overlaps: expected one overlap a cell, received {len(overlaps)}")
    if isinstance(trials, bool) or not isinstance(trials, int) or trials < 1:
        raise InputError(f"trials: expected a whole number of at least 1, received {trials!r}")
    fixed = read_mm(require_path(target, "target", "the file of a fixed surface"), "target", None)
    moved, truth = _moving(moving, moving_truth, fixed)
    targets_mm, targets = _targets(centerline, fixed)
    try:
        task = RobustnessTrial(
            name,
            method,
            perturbation,
            Piece(float(overlaps[0]), piece),
            moved,
            fixed,
            truth,
            targets_mm,
            seed,
        )
    except registration_errors.InputError as refusal:
        raise InputError(f"overlaps, piece: {refusal}") from refusal
    rows = list(progress.track(_solved(task, trials, workers), f"{name}, overlap {overlaps[0]:g}", trials))
    return _outcome(rows, {"tre_targets": targets, "tre_targets_n": str(len(targets_mm))})


def summarise(cells: list[CellResult]) -> Outcome:
    """Set all methods and overlaps side by side: one table, success against angle, RMSE against TRE."""
    import pandas as pd

    frames = [cell.cases for cell in cells if cell.cases is not None and len(cell.cases)]
    if not frames:
        return Outcome(findings=("No cell has trials to summarise.",))
    cases = pd.concat(frames, ignore_index=True)
    return Outcome(
        cases=cases, tables={"robustness": table(cases)}, figures=figures(cases), findings=describe(cases)
    )


def _moving(moving: str | None, moving_truth: str | None, fixed: Surface) -> tuple[Surface, np.ndarray]:
    """The surface that moves and its true pose; without a file of the user's, the fixed surface itself."""
    if moving is None:
        if moving_truth is not None:
            raise InputError("moving_truth: expected a moving file with it, received none")
        return fixed, np.eye(4)
    truth_path = require_path(moving_truth, "moving_truth", "a JSON file with the fixed_T_moving of moving")
    surface = read_mm(Path(moving), "moving", None)
    hint = "convert the file to millimetres first"
    refuse_metres(surface, fixed, "moving", None, hint)
    refuse_metres(fixed, surface, "target", None, hint)
    return surface, read_pose(truth_path, "moving_truth")


def _targets(centerline: str | None, fixed: Surface) -> tuple[np.ndarray, str]:
    """The points of the fixed side that the error is measured at, and what they are."""
    if centerline is not None:
        try:
            return read_centerline(Path(centerline)).even_points(MOST_TARGETS), "centerline"
        except registration_errors.InputError as refusal:
            raise InputError(f"centerline: {refusal}") from refusal
    rng = np.random.default_rng(TARGET_SEED)
    if isinstance(fixed, Mesh):
        return fixed.sample(MOST_TARGETS, rng), "surface"
    return rng.permutation(fixed, axis=0)[:MOST_TARGETS], "surface"


def _solved(task: RobustnessTrial, trials: int, workers: int) -> Iterator[dict[str, Any]]:
    """The rows in order of trial, from this process or from several."""
    if isinstance(workers, bool) or not isinstance(workers, int) or workers < 1:
        raise InputError(f"workers: expected a whole number of at least 1, received {workers!r}")
    if workers == 1:
        yield from map(task, range(trials))
        return
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    # A fresh interpreter for each: forking after Open3D has started its threads can hang.
    with ProcessPoolExecutor(min(workers, trials), mp_context=get_context("spawn")) as pool:
        yield from pool.map(task, range(trials), chunksize=max(trials // (8 * workers), 1))


def _outcome(rows: list[dict[str, Any]], tags: dict[str, str]) -> Outcome:
    import pandas as pd

    cases: pd.DataFrame = pd.DataFrame(rows)
    metrics = success_metrics(cases)
    for name in (
        "rmse_mm",
        "tre_mm",
        "tre_max_mm",
        "tre_covered_mm",
        "rotation_error_deg",
        "translation_error_mm",
    ):
        metrics |= summary(name, cases[name].tolist())
    metrics |= summary("runtime_s", cases["runtime_s"].tolist())
    return Outcome(
        metrics=metrics,
        cases=cases,
        tables={"robustness": table(cases)},
        figures=figures(cases),
        findings=describe(cases),
        tags=tags,
    )
