"""Does a job of the project each time a line comes in, for benchmarks that compare two trees of it.

    PYTHONPATH=<tree>/src python scripts/earlier_worker.py gather 40

Prepares once, then answers each line with what describes the result, as JSON; ends with the input.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np


def gather(size: int) -> Callable[[], list[float]]:
    """Contours and filters of so many masks of a simulated sweep."""
    from bench_sweep_faults import AFTER, simulated

    sweep = simulated("artery", 1, size, 1.5)
    return lambda: described(AFTER.gather(sweep.masks, sweep.poses).cloud.points_mm)


def rough_borders(size: int) -> Callable[[], list[float]]:
    """The borders of a tube of so many rings that has lost a tenth of its triangles."""
    from registration.geometry.mesh_topology import borders, keep_triangles
    from registration.geometry.shapes import Mesh

    around = 48
    angle = 2 * np.pi * np.arange(around) / around
    rings = [
        np.stack([4 * np.cos(angle), 4 * np.sin(angle), np.full(around, 0.8 * k)], 1) for k in range(size)
    ]
    low = np.arange(around * (size - 1))
    beside = low - low % around + (low + 1) % around
    triangles = np.concatenate(
        [np.stack([low, beside, low + around], 1), np.stack([beside, beside + around, low + around], 1)]
    )
    kept = np.random.default_rng(0).random(len(triangles)) > 0.1
    mesh = keep_triangles(Mesh(np.concatenate(rings), triangles), kept)

    def values() -> list[float]:
        # Sorted, as many holes are of one size but for rounding, which decides in what order they come.
        found = borders(mesh)
        return sorted(rim.radius_mm for rim in found) + sorted(rim.facing for rim in found)

    return values


def figure_files(size: int) -> Callable[[], list[float]]:
    """A figure of so many panels, written as PNG and SVG."""
    import tempfile

    from matplotlib.figure import Figure
    from PIL import Image

    from experiments.reporting.figure_files import save_figure

    folder = tempfile.mkdtemp()

    def written() -> list[float]:
        figure = Figure(figsize=(10, 4.4), layout="constrained")
        for axes in np.ravel(figure.subplots(1, size)):
            axes.plot(range(30), label="a method")
            axes.set(xlabel="Rotation (deg)", ylabel="Success rate (%)", title="A condition")
            axes.legend()
        save_figure(figure, Path(folder) / "figure")
        # The picture itself; an SVG may be cut by a fraction of a point otherwise.
        with Image.open(Path(folder) / "figure.png") as opened:
            pixels = np.asarray(opened)
        return [*map(float, pixels.shape), float(pixels.mean()), float(pixels.std())]

    return written


def described(points_mm: np.ndarray) -> list[float]:
    """The size of a cloud, and means and deviations of its coordinates in mm."""
    return [float(len(points_mm)), *points_mm.mean(axis=0).tolist(), *points_mm.std(axis=0).tolist()]


JOBS = {"gather": gather, "rough_borders": rough_borders, "figure_files": figure_files}


def main() -> None:
    """Prepare, then do the job for each line."""
    work = JOBS[sys.argv[1]](int(sys.argv[2]))
    for _ in sys.stdin:
        print(json.dumps(work()), flush=True)


if __name__ == "__main__":
    main()
