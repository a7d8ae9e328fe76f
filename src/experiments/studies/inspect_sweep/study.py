"""Study ``inspect_sweep``: one page on which a tracked sweep can be looked at and checked."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from experiments import files
from experiments.inputs.paths import SweepReader, describe_dropped, interval_ms, require_exists
from experiments.outcome import Outcome, Progress
from experiments.paths import PathSetting

if TYPE_CHECKING:
    import pandas as pd

    from registration.sweep import PosedFrames, TrackedSweep

# A sweep along a vessel moves by centimetres; one of so many poses that stays within this is in metres, or only turns.
STILL_MM = 1.0
FEW_POSES = 10


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
    max_gap_s: float,
    offset_s: float,
    shown_frames: int,
    shown_px: int,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Read and synchronise the sweep and leave ``sweep.html``, a self-contained page, in ``workspace``.

    Parameters
    ----------
    sweep : PathSetting
        Path of the tracked sweep: a folder, ``.igs.mha``, ``.igs.nrrd`` or bag.
    acquisition : SweepReader
        Reader of the sweep.
    max_gap_s : float
        A frame in a longer gap in s between two poses is dropped.
    offset_s : float
        Added to the times of the poses, in s.
    shown_frames : int
        Maximum number of frames in the page, evenly chosen.
    shown_px : int
        Larger side of the frames in the page in px.
    workspace : Path
        Folder of the run in which result files are left.
    progress : Progress
        Receives notes and progress.

    Returns
    -------
    Outcome
        Metrics, a row for each frame, the table and findings.

    Raises
    ------
    InputError
        If ``sweep`` does not exist.
    """
    from experiments.studies.inspect_sweep.page import page
    from registration.synchronisation import drop_reasons, synchronise

    path = require_exists(sweep, "sweep")
    recorded = acquisition(path)
    posed = synchronise(recorded, max_gap_s, offset_s)
    reasons = drop_reasons(recorded, max_gap_s, offset_s)
    table = _table(recorded, posed)
    progress.note(f"drawing {min(shown_frames, len(recorded.images))} of {len(recorded.images)} frames")
    html = page(path.name, recorded, posed, reasons, table, shown_frames, shown_px, progress)
    files.write_text(workspace / "sweep.html", html)
    return Outcome(
        metrics=_metrics(recorded, posed),
        cases=_cases(recorded, posed, reasons),
        tables={"sweep": table},
        findings=(
            f"{len(posed.kept)} of {len(recorded.images) + recorded.frames_dropped} frames have a pose; "
            f"dropped: {describe_dropped(posed.dropped)}. Open sweep.html in a browser.",
            *recorded.notes,
            *_of_span(recorded),
        ),
    )


def _of_span(sweep: TrackedSweep) -> Iterator[str]:
    """What to look at where the end effector hardly moved."""
    span_mm = float(np.linalg.norm(np.ptp(sweep.world_T_ee[:, :3, 3], axis=0)))
    if len(sweep.world_T_ee) >= FEW_POSES and span_mm < STILL_MM:
        yield (
            f"The end effector moved {span_mm:.2g} mm in all: a sweep whose poses are in metres needs units: m, and "
            "one that only turned shows no length of a vessel."
        )


def _metrics(sweep: TrackedSweep, posed: PosedFrames) -> dict[str, float]:
    image_ms, pose_ms = interval_ms(sweep.image_times_s), interval_ms(sweep.pose_times_s)
    return {
        "frames": float(len(sweep.images)),
        "frames_kept": float(len(posed.kept)),
        "frames_dropped": float(posed.frames_dropped),
        "poses": float(len(sweep.world_T_ee)),
        "frame_interval_ms_median": image_ms[0],
        "frame_interval_ms_max": image_ms[1],
        "pose_interval_ms_median": pose_ms[0],
        "pose_interval_ms_max": pose_ms[1],
    }


def _table(sweep: TrackedSweep, posed: PosedFrames) -> pd.DataFrame:
    """What there is to know of a sweep, a line each."""
    import pandas as pd

    from registration.calibration.probe import pixel_geometry

    geometry = pixel_geometry(sweep.calibration.probe_A_pixel)
    image_ms, pose_ms = interval_ms(sweep.image_times_s), interval_ms(sweep.pose_times_s)
    # The length of the path would add up the poses' noise; the span does not.
    span_mm = np.ptp(sweep.world_T_ee[:, :3, 3], axis=0)
    duration_s = float(np.ptp(sweep.image_times_s)) if len(sweep.image_times_s) else float("nan")
    height, width = sweep.images.shape[1:]
    lines = [
        ("frames", f"{len(sweep.images)} of {width} x {height} px over {duration_s:.2f} s"),
        ("frames with a pose", str(len(posed.kept))),
        ("frames dropped", describe_dropped(posed.dropped)),
        ("interval between frames", f"median {image_ms[0]:.1f} ms, largest {image_ms[1]:.1f} ms"),
        ("poses", str(len(sweep.world_T_ee))),
        ("interval between poses", f"median {pose_ms[0]:.1f} ms, largest {pose_ms[1]:.1f} ms"),
        ("span of the end effector", " x ".join(f"{side:.1f}" for side in span_mm) + " mm"),
        ("pixel size", f"{geometry.column_mm:.4f} mm across, {geometry.row_mm:.4f} mm down"),
        ("shear of the image", f"{geometry.shear_deg:.2f} degrees"),
    ]
    return pd.DataFrame(lines, columns=["what", "value"])


def _cases(sweep: TrackedSweep, posed: PosedFrames, reasons: np.ndarray) -> pd.DataFrame:
    """A row a frame: its time, why it has no pose, and where its pose puts the image's first pixel."""
    import pandas as pd

    places_mm = np.full((len(sweep.images), 3), np.nan)
    places_mm[posed.kept] = posed.world_A_pixel[:, :3, 3]
    columns = {f"{axis}_mm": places_mm[:, index] for index, axis in enumerate("xyz")}
    return pd.DataFrame(
        {"frame": np.arange(len(sweep.images)), "time_s": sweep.image_times_s, "dropped": reasons, **columns}
    )
