"""What the studies on tracked sweeps share: where a sweep comes from, and what to say of its timing."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from experiments import files
from experiments.errors import InputError
from experiments.outcome import InputData

if TYPE_CHECKING:
    from registration.sweep import TrackedSweep

SweepReader = Callable[[Path], "TrackedSweep"]


def require_exists(path: str, setting: str) -> Path:
    """Check that a file or folder is there.

    Parameters
    ----------
    path : str
        The path in a setting.
    setting : str
        Name of the setting, for the message.

    Returns
    -------
    Path
        The path.

    Raises
    ------
    InputError
        If there is nothing.
    """
    found = Path(path).expanduser()
    if not found.exists():
        raise InputError(f"{setting}: expected a file or folder, received {path!r}, where there is none")
    return found


def input_data(path: Path) -> InputData:
    """Describe a file by its digest, or a folder by the names and digests of all files in it.

    Parameters
    ----------
    path : Path
        A file or folder.

    Returns
    -------
    InputData
        Name, digest and path.
    """
    if path.is_file():
        return InputData(path.name, files.digest(path), str(path))
    total = hashlib.sha256()
    for file in sorted(found for found in path.rglob("*") if found.is_file()):
        total.update(f"{file.relative_to(path).as_posix()} {files.digest(file)}\n".encode())
    return InputData(path.name, total.hexdigest(), str(path))


def interval_ms(times_s: np.ndarray) -> tuple[float, float]:
    """Compute the intervals between successive times.

    Parameters
    ----------
    times_s : ndarray, shape (n,)
        Times.

    Returns
    -------
    (float, float)
        Median and largest interval in ms; NaN for fewer than two times.
    """
    if len(times_s) < 2:
        return float("nan"), float("nan")
    intervals = np.diff(times_s) * 1e3
    return float(np.median(intervals)), float(intervals.max())


def describe_dropped(dropped: Mapping[str, int]) -> str:
    """Describe the counts of dropped frames as part of a sentence.

    Parameters
    ----------
    dropped : mapping of str to int
        Number of frames by reason.

    Returns
    -------
    str
        The counts, or none.
    """
    return ", ".join(f"{count} {reason}" for reason, count in dropped.items()) or "none"
