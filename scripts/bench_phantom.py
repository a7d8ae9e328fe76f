"""How long the simulator takes for a whole data set, frames a second, and how much memory it needs.

    python scripts/bench_phantom.py [--sweeps 8] [--frames 200] [--size-px 512] [--workers 2] [--quick]

Frames go to an empty folder that is removed at the end, so nothing comes from the cache.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time

from quick_budget import parsed

from experiments.datasets.phantom import Phantom


def main() -> None:
    """Simulate and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    for name, value in (("sweeps", 8), ("frames", 200), ("size-px", 512), ("workers", 2)):
        parser.add_argument(f"--{name}", type=int, default=value)
    given = parsed(parser, {"sweeps": 1, "frames": 10, "size_px": 128, "workers": 1})
    with tempfile.TemporaryDirectory() as cache:
        dataset = Phantom(
            sweeps=given.sweeps,
            frames_per_sweep=given.frames,
            size_px=given.size_px,
            workers=given.workers,
            cache=cache,
        )
        begin_s = time.perf_counter()
        count = len(dataset())
        seconds = time.perf_counter() - begin_s
    # A few frames are simulated in this process, whatever the number of workers.
    simulating = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    peak_mb = (simulating or resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) / 1024
    print(f"{count} frames of {given.size_px} x {given.size_px} in {seconds:.0f} s, workers={given.workers}:")
    print(f"{count / seconds:.1f} frames a second, at most {peak_mb:.0f} MB in a process that simulates")


if __name__ == "__main__":
    main()
