"""Study ``calibrate_temporal``: the lag of the tracker behind the images."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from experiments import files
from experiments.errors import InputError
from experiments.inputs.paths import SweepReader, require_exists
from experiments.outcome import Outcome, Progress
from experiments.paths import PathSetting
from experiments.reporting.labels import axis_label

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from registration.calibration.line_detection import LineDetector
    from registration.calibration.temporal import TemporalCalibration, TemporalResult


def check(*, sweep: PathSetting) -> None:
    """Check that the sweep exists.

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
    line: LineDetector,
    temporal: TemporalCalibration,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Find the lag of the tracker and leave ``temporal_calibration.json`` in ``workspace``.

    The ``offset_s`` in that file is the one to pass to synchronisation.

    Parameters
    ----------
    sweep : PathSetting
        Path of the tracked sweep: a folder, ``.igs.mha``, ``.igs.nrrd`` or bag.
    acquisition : SweepReader
        Reader of the sweep.
    line : LineDetector
        Detector of the line in the images.
    temporal : TemporalCalibration
        Temporal calibration method.
    workspace : Path
        Folder of the run in which result files are left.
    progress : Progress
        Receives notes and progress.

    Returns
    -------
    Outcome
        Metrics, a row for each frame, figures of signals and correlation, and findings.

    Raises
    ------
    InputError
        If ``sweep`` does not exist or has poses only.
    """
    from registration.calibration.temporal import principal_motion_mm

    recorded = acquisition(require_exists(sweep, "sweep"))
    if not len(recorded.images):
        raise InputError(f"sweep: expected frames in {sweep}, received a recording of poses only")
    progress.note(f"looking for the line in {len(recorded.images)} frames")
    rows_px = line(recorded.images)
    # The principal axis is that of the motion during the images, not of what the tracker saw before and after.
    beyond_s = 2 * temporal.max_lag_s
    near = (recorded.pose_times_s >= recorded.image_times_s.min() - beyond_s) & (
        recorded.pose_times_s <= recorded.image_times_s.max() + beyond_s
    )
    pose_times_s = recorded.pose_times_s[near]
    motion_mm = principal_motion_mm(recorded.world_T_ee[near, :3, 3])
    result = temporal(recorded.image_times_s, rows_px, pose_times_s, motion_mm)
    cases = _cases(recorded.image_times_s, rows_px, pose_times_s, motion_mm, result)
    # A single peak has no runner-up: its values are left out, not reported as a failure.
    metrics = {key: value for key, value in _metrics(cases, result).items() if np.isfinite(value)}
    files.write_text(workspace / "temporal_calibration.json", json.dumps(metrics, indent=2) + "\n")
    return Outcome(
        metrics=metrics,
        cases=cases,
        figures={"signals": _signals(cases, result), "correlation": _curve(result)},
        findings=(
            f"The tracker lags the images by {result.tracker_lag_s * 1e3:.1f} ms (correlation "
            f"{abs(result.correlation):.3f}): synchronise with offset_s={result.offset_s:.4f}.",
            *recorded.notes,
        ),
    )


def _metrics(cases: pd.DataFrame, result: TemporalResult) -> dict[str, float]:
    return {
        "tracker_lag_s": result.tracker_lag_s,
        "offset_s": result.offset_s,
        "correlation": result.correlation,
        "runner_up_lag_s": result.runner_up_lag_s,
        "runner_up_correlation": result.runner_up_correlation,
        "residual_rms_px": float(np.sqrt(np.nanmean(cases["residual_px"] ** 2))),
        "frames_with_line": float(cases["row_px"].notna().sum()),
        "frames_used": float(result.frames_used.sum()),
    }


def _cases(
    image_times_s: np.ndarray,
    rows_px: np.ndarray,
    pose_times_s: np.ndarray,
    motion_mm: np.ndarray,
    result: TemporalResult,
) -> pd.DataFrame:
    """Per frame: the line's row, the motion at the frame's time with and without the lag, and what is left."""
    import pandas as pd

    at_lag_mm = np.interp(image_times_s + result.tracker_lag_s, pose_times_s, motion_mm)
    used = result.frames_used
    slope, shift = np.polyfit(at_lag_mm[used], rows_px[used], 1)
    return pd.DataFrame(
        {
            "time_s": image_times_s,
            "row_px": rows_px,
            "motion_uncorrected_px": slope * np.interp(image_times_s, pose_times_s, motion_mm) + shift,
            "motion_px": slope * at_lag_mm + shift,
            "residual_px": np.where(used, rows_px - (slope * at_lag_mm + shift), np.nan),
            "used": used,
        }
    )


def _signals(cases: pd.DataFrame, result: TemporalResult) -> Figure:
    """Both signals over time, and the residual with and without the lag."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 6), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    elapsed_s = cases["time_s"] - cases["time_s"].iloc[0]
    above.plot(elapsed_s, cases["row_px"], ".", label="Line in the image")
    above.plot(elapsed_s, cases["motion_px"], "-", label=f"Tracker, lag {result.tracker_lag_s * 1e3:.1f} ms")
    above.set_ylabel(axis_label("row_px"))
    above.legend()
    below.plot(elapsed_s, cases["row_px"] - cases["motion_uncorrected_px"], ".", label="Uncorrected")
    below.plot(elapsed_s, cases["residual_px"], ".", label="Corrected")
    below.set(xlabel=axis_label("time_s"), ylabel=axis_label("residual_px"))
    below.legend()
    return figure


def _curve(result: TemporalResult) -> Figure:
    """Correlation over lag."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 4), layout="constrained")
    axes = figure.subplots()
    axes.plot(result.lags_s, np.abs(result.correlations))
    axes.axvline(result.tracker_lag_s, linestyle="--", color="black")
    axes.set(xlabel=axis_label("lag_s"), ylabel="Absolute correlation")
    return figure
