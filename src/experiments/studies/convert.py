"""Study ``convert``: a tracked sweep from one format into another."""

from __future__ import annotations

from pathlib import Path

from experiments.errors import InputError
from experiments.inputs.paths import SweepReader, describe_dropped, require_exists
from experiments.outcome import Outcome, Progress
from experiments.paths import PathSetting

# A conversion measures nothing: the tracker would only keep a second copy of the files.
TRACKED = False
FORMATS = ("folder", "plus_mha", "plus_nrrd", "ros2_mcap", "ros2_sqlite3")


def check(*, input: PathSetting, format: str) -> None:
    """Check that the input exists and the format is known.

    Parameters
    ----------
    input : PathSetting
        Path of the tracked sweep.
    format : str
        One of ``FORMATS``.

    Raises
    ------
    InputError
        If ``input`` does not exist or ``format`` is unknown.
    """
    require_exists(input, "input")
    if format not in FORMATS:
        raise InputError(f"format: expected {', '.join(FORMATS)}, received {format!r}")


def run(
    *,
    input: PathSetting,
    acquisition: SweepReader,
    format: str,
    max_gap_s: float,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Convert a tracked sweep into ``sweep``, ``sweep.igs.mha`` or ``sweep.igs.nrrd`` in ``workspace``.

    Folders and bags keep both streams with their own times. A PLUS file holds one pose per frame, brought to
    the frame's time; frames without one are left out and counted.

    Parameters
    ----------
    input : PathSetting
        Path of the tracked sweep.
    acquisition : SweepReader
        Reader of the sweep.
    format : str
        One of ``FORMATS``.
    max_gap_s : float
        In a PLUS file no pose is made across a longer gap in s between two poses.
    workspace : Path
        Folder of the run in which result files are left.
    progress : Progress
        Receives notes and progress.

    Returns
    -------
    Outcome
        Numbers of frames written and dropped, and findings.

    Raises
    ------
    InputError
        If ``input`` does not exist or ``format`` is unknown.
    """
    from registration.readers.folder import write_folder
    from registration.readers.plus.writer import write_plus
    from registration.readers.rosbag.writer import write_bag
    from registration.sweep import count_frames

    check(input=input, format=format)
    progress.note(f"reading {input}")
    sweep = acquisition(require_exists(input, "input"))
    dropped = dict(sweep.dropped)
    kind, _, variant = format.partition("_")
    target = workspace / ("sweep" if kind != "plus" else f"sweep.igs.{variant}")
    progress.note(f"writing {len(sweep.images)} frames and {len(sweep.world_T_ee)} poses as {format}")
    if kind == "plus":
        dropped = write_plus(target, sweep, max_gap_s)
    elif kind == "ros2":
        write_bag(target, sweep, variant)
    else:
        write_folder(target, sweep)
    lost = sum(dropped.values()) - sum(sweep.dropped.values())
    written = len(sweep.images) - lost
    return Outcome(
        metrics={"frames": float(written), "frames_dropped": float(count_frames(dropped))},
        findings=(
            f"{target.name}: {written} frames and {len(sweep.world_T_ee)} poses from {input}; "
            f"frames left out: {describe_dropped(dropped)}.",
            *sweep.notes,
        ),
    )
