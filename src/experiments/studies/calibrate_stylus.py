"""Study ``calibrate_stylus``: the tip of a tracked stylus."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from experiments import files
from experiments.inputs.paths import SweepReader, require_exists
from experiments.outcome import Outcome, Progress
from experiments.paths import PathSetting
from experiments.reporting.labels import axis_label

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from registration.calibration.stylus import PivotCalibration, PivotResult


def check(*, sweep: PathSetting) -> None:
    """Check that the recording exists.

    Parameters
    ----------
    sweep : PathSetting
        Path of the tracked sweep: a folder, ``.igs.mha``, ``.igs.nrrd`` or bag.

    Raises
    ------
    InputError
        If ``sweep`` does not exist.
    """
    require_exists(sweep, "sweep")


def run(
    *,
    sweep: PathSetting,
    acquisition: SweepReader,
    pivot: PivotCalibration,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Find the tip of a stylus and leave ``stylus_calibration.json`` in ``workspace``.

    Parameters
    ----------
    sweep : PathSetting
        Path of the recording, whose poses turn the stylus about its tip.
    acquisition : SweepReader
        Reader of the recording.
    pivot : PivotCalibration
        Pivot calibration method.
    workspace : Path
        Folder of the run in which result files are left.
    progress : Progress
        Receives notes and progress.

    Returns
    -------
    Outcome
        Metrics, a row for each pose, the figure of residuals, and findings.

    Raises
    ------
    InputError
        If ``sweep`` does not exist.
    """
    import pandas as pd

    recorded = acquisition(require_exists(sweep, "sweep"))
    progress.note(f"pivot calibration from {len(recorded.world_T_ee)} poses")
    result = pivot(recorded.world_T_ee)
    length_mm = float(np.linalg.norm(result.tip_mm))
    record = {
        "tip_mm": result.tip_mm.tolist(),
        "pivot_mm": result.pivot_mm.tolist(),
        "rmse_mm": result.rmse_mm,
        "weakest_mm": result.weakest_mm,
    }
    files.write_text(workspace / "stylus_calibration.json", json.dumps(record, indent=2) + "\n")
    cases = pd.DataFrame(
        {"time_s": recorded.pose_times_s, "residual_mm": result.residuals_mm, "outlier": result.outliers}
    )
    return Outcome(
        metrics={
            "tip_length_mm": length_mm,
            "rmse_mm": result.rmse_mm,
            "weakest_mm": result.weakest_mm,
            "outliers": float(result.outliers.sum()),
        },
        cases=cases,
        figures={"residuals": _figure(recorded.pose_times_s, result)},
        findings=(
            f"Tip at {', '.join(f'{value:.3f}' for value in result.tip_mm)} mm, {length_mm:.3f} mm from the marker; "
            f"RMSE {result.rmse_mm:.3f} mm, standard error {result.weakest_mm:.3f} mm in the weakest direction, "
            f"{int(result.outliers.sum())} of {len(cases)} poses left out.",
            *recorded.notes,
        ),
    )


def _figure(times_s: np.ndarray, result: PivotResult) -> Figure:
    """Residuals over time."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 4), layout="constrained")
    axes = figure.subplots()
    elapsed_s, kept = times_s - times_s[0], ~result.outliers
    axes.plot(elapsed_s[kept], result.residuals_mm[kept], ".", label="Used")
    axes.plot(elapsed_s[~kept], result.residuals_mm[~kept], "x", label="Left out")
    axes.set(xlabel=axis_label("time_s"), ylabel=axis_label("residual_mm"))
    axes.legend()
    return figure
