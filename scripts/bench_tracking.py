"""What tracking costs of a robustness sweep of many trials: seconds in the tracker, and of the whole.

    python scripts/bench_tracking.py [--trials 10000] [--overlaps 1.0] [--iterations 5] [--quick]

A bent tube is registered to itself from random poses by single ICP on few points and, to make tracking as large a share
as can be, stopped after few iterations: a slower method has the same runs and the same rows. Counted is every call of
the project to its tracker, opening the store and importing MLflow included; a store and a project of its own are made
before.
"""

from __future__ import annotations

import argparse
import functools
import os
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from quick_budget import REPOSITORY, parsed

sys.path.insert(0, str(REPOSITORY / "tests" / "support"))
STORE = (
    "client",
    "start",
    "reopen",
    "save_view",
    "finished",
    "mark_orphans_failed",
    "metrics",
    "cases",
    "run",
)
WRITER = (
    *("params", "metrics", "history", "points", "tags", "drop_tags", "inputs", "text", "files"),
    *("end", "withdraw"),
)


class Clock:
    """Seconds inside calls of some methods; of nested ones the outermost counts."""

    def __init__(self) -> None:
        self.seconds: Counter[str] = Counter()
        self.calls: Counter[str] = Counter()
        self._inside = False

    def watch(self, owner: type, names: tuple[str, ...]) -> None:
        """Have methods counted."""
        for name in names:
            setattr(owner, name, self._timed(getattr(owner, name), f"{owner.__name__}.{name}"))

    def _timed(self, method: Callable[..., Any], name: str) -> Callable[..., Any]:
        @functools.wraps(method)
        def timed(*given: Any, **named: Any) -> Any:
            if self._inside:
                return method(*given, **named)
            self._inside, begun_s = True, time.perf_counter()
            try:
                return method(*given, **named)
            finally:
                self.seconds[name] += time.perf_counter() - begun_s
                self.calls[name] += 1
                self._inside = False

        return timed


def main() -> int:
    """Run the sweep and print the seconds."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--trials", type=int, default=10_000)
    parser.add_argument("--overlaps", default="1.0", help="shares of the vessel, each with as many trials")
    parser.add_argument(
        "--iterations", type=int, default=5, help="of a trial at most; 100 is the study's own"
    )
    given = parsed(parser, {"trials": 20})
    os.environ["OMP_NUM_THREADS"] = "1"
    with tempfile.TemporaryDirectory() as folder:
        os.environ["CTUS_HOME"] = folder
        os.environ.pop("MLFLOW_TRACKING_URI", None)
        prepare(Path(folder))
        clock, code, whole_s = measured(Path(folder), given)
        files = [path for path in (Path(folder) / "mlruns").rglob("*") if path.is_file()]
        size_mb = sum(path.stat().st_size for path in files) / 1e6
    if code:
        return code
    tracking_s = sum(clock.seconds.values())
    print(
        f"{given.trials} trials at overlaps {given.overlaps}, {given.iterations} iterations: whole {whole_s:.1f} s, "
        f"store {size_mb:.1f} MB"
    )
    for name, seconds in clock.seconds.most_common():
        print(f"  {name:28s} {seconds:8.2f} s  {clock.calls[name]:5d} calls")
    print(f"tracking {tracking_s:.2f} s of {whole_s:.1f} s: {tracking_s / whole_s:.2%}")
    return 0


def prepare(folder: Path) -> None:
    """A surface, and a store that is there already, in a process of its own: here nothing of MLflow is loaded."""
    import subprocess

    from vessels import bent_tube

    from registration.io.surfaces import write_surface

    write_surface(folder / "tube.ply", bent_tube())
    code = "from experiments.tracking import Store; Store().client()"
    subprocess.run([sys.executable, "-c", code], check=True)


def measured(folder: Path, given: argparse.Namespace) -> tuple[Clock, int, float]:
    """The clock, the exit code and the seconds of the call."""
    from experiments.cli import main as ctus
    from experiments.tracking import RunWriter, Store

    clock = Clock()
    clock.watch(Store, STORE)
    clock.watch(RunWriter, WRITER)
    words = [
        "study=robustness",
        f"target={folder / 'tube.ply'}",
        "rigid=[single_icp]",
        f"trials={given.trials}",
    ]
    words += [f"overlaps=[{given.overlaps}]", "perturbation.moving_points=300", f"out={folder / 'out'}"]
    words += ["perturbation.fixed_points=1000", f"rigid.single_icp.max_iterations={given.iterations}"]
    begun_s = time.perf_counter()
    code = ctus(words)
    return clock, code, time.perf_counter() - begun_s


if __name__ == "__main__":
    sys.exit(main())
