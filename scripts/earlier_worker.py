"""Does a job of the project each time a line comes in, for benchmarks that compare two trees of it.

    PYTHONPATH=<tree>/src python scripts/earlier_worker.py gather 40

Prepares once, then answers each line with what describes the result, as JSON; ends with the input.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable

import numpy as np


def gather(size: int) -> Callable[[], list[float]]:
    """Contours and filters of so many masks of a simulated sweep."""
    from bench_sweep_faults import AFTER, simulated

    sweep = simulated("artery", 1, size, 1.5)
    return lambda: described(AFTER.gather(sweep.masks, sweep.poses).cloud.points_mm)


def described(points_mm: np.ndarray) -> list[float]:
    """The size of a cloud, and means and deviations of its coordinates in mm."""
    return [float(len(points_mm)), *points_mm.mean(axis=0).tolist(), *points_mm.std(axis=0).tolist()]


JOBS = {"gather": gather}


def main() -> None:
    """Prepare, then do the job for each line."""
    work = JOBS[sys.argv[1]](int(sys.argv[2]))
    for _ in sys.stdin:
        print(json.dumps(work()), flush=True)


if __name__ == "__main__":
    main()
