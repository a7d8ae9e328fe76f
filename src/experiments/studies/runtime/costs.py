"""Seconds and peak memory of one stage."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

STATUS, RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")
# Written to clear_refs, it makes the kernel take the present memory for the peak (proc(5)).
RESET_PEAK = "5"


@dataclass(frozen=True)
class Cost:
    """What one stage took.

    Parameters
    ----------
    stage : str
        Name of the stage.
    seconds : float
        Wall-clock time in s; NaN for a stage that failed.
    peak_memory_mb : float
        Largest resident memory of the process during the stage in 10^6 bytes; NaN where it is not known.
    modelled : bool, optional
        Whether the time is computed and not measured.
    error : str, optional
        Why the stage failed; empty where it did not.
    """

    stage: str
    seconds: float
    peak_memory_mb: float
    modelled: bool = False
    error: str = ""


@contextmanager
def measured(costs: list[Cost], stage: str) -> Iterator[None]:
    """Measure the block and append what it took.

    Parameters
    ----------
    costs : list of Cost
        Gets the cost when the block ends.
    stage : str
        Name of the stage.
    """
    known = _reset_peak()
    begin_s = time.perf_counter()
    yield
    seconds = time.perf_counter() - begin_s
    costs.append(Cost(stage, seconds, _peak_mb() if known else float("nan")))


def _reset_peak() -> bool:
    """Whether the peak begins anew: only Linux offers it, elsewhere it would be that of all stages so far."""
    try:
        RESET.write_text(RESET_PEAK)
    except OSError:
        return False
    return True


def _peak_mb() -> float:
    lines = STATUS.read_text(encoding="ascii", errors="replace").splitlines()
    kilobytes = next(line.split()[1] for line in lines if line.startswith("VmHWM:"))
    return int(kilobytes) * 1024 / 1e6
