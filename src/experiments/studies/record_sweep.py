"""Study ``record_sweep``: a live OpenIGTLink stream into a plain sweep folder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from experiments.inputs.paths import describe_dropped, require_exists
from experiments.outcome import Outcome, Progress
from experiments.paths import PathSetting

if TYPE_CHECKING:
    from registration.readers.live import LiveRecorder

TRACKED = False
# A line every so many frames: a stream has no end that a bar could run towards.
_FRAMES_A_LINE = 100


def check(*, calibration: PathSetting) -> None:
    """Check that the calibration exists.

    Parameters
    ----------
    calibration : PathSetting
        File of the probe's calibration.

    Raises
    ------
    InputError
        If ``calibration`` does not exist.
    """
    require_exists(calibration, "calibration")


def run(*, live: LiveRecorder, duration_s: float, workspace: Path, progress: Progress) -> Outcome:
    """Record a sweep and leave it in ``workspace`` as the folder ``sweep``.

    Parameters
    ----------
    live : LiveRecorder
        Recorder of the live streams of images and poses.
    duration_s : float
        Length of the recording in s.
    workspace : Path
        Folder of the run in which result files are left.
    progress : Progress
        Receives notes and progress.

    Returns
    -------
    Outcome
        Numbers of frames, poses and interruptions, and findings.
    """
    from registration.readers.folder import write_folder

    def tell(count: int) -> None:
        if count % _FRAMES_A_LINE == 0:
            progress.note(f"{count} frames")

    progress.note(f"recording from {live.host}:{live.port} for {duration_s:g} s")
    recording = live(duration_s=duration_s, on_frame=tell)
    sweep = recording.sweep
    write_folder(workspace / "sweep", sweep)
    away_s = sum(gap.ended_s - gap.began_s for gap in recording.interruptions)
    return Outcome(
        metrics={
            "frames": float(len(sweep.images)),
            "poses": float(len(sweep.world_T_ee)),
            "interruptions": float(len(recording.interruptions)),
        },
        findings=(
            f"sweep: {len(sweep.images)} frames and {len(sweep.world_T_ee)} poses; the connection was lost "
            f"{len(recording.interruptions)} times, {away_s:.1f} s in all; "
            f"frames left out: {describe_dropped(sweep.dropped)}.",
        ),
    )
