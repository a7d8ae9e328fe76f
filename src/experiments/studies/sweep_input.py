"""What the studies on tracked sweeps share: where a sweep comes from, and what to say of its timing."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from experiments.errors import InputError

if TYPE_CHECKING:
    from registration.sweep import TrackedSweep

SweepReader = Callable[[Path], "TrackedSweep"]


def require_exists(path: str, setting: str) -> Path:
    """The path in a setting, or InputError where nothing lies there."""
    found = Path(path).expanduser()
    if not found.exists():
        raise InputError(f"{setting}: expected a file or folder, received {path!r}, where there is none")
    return found


def interval_ms(times_s: np.ndarray) -> tuple[float, float]:
    """Median and largest interval between successive times, in ms; NaN for fewer than two."""
    if len(times_s) < 2:
        return float("nan"), float("nan")
    intervals = np.diff(times_s) * 1e3
    return float(np.median(intervals)), float(intervals.max())


def describe_dropped(dropped: Mapping[str, int]) -> str:
    """The counts of dropped frames as part of a sentence."""
    return ", ".join(f"{count} {reason}" for reason, count in dropped.items()) or "none"
