"""Deformable registration of a bent tube by size: ours along the wall, rustcpd, and pycpd where it is installed.

A designed artery is bent by 3.1 mm; both clouds are drawn apart from each other, the swept one with noise of 0.3 mm.
All methods get the same clouds in the same minute, each in a process of its own for its peak memory. The true error is
that of material points; the residual RMSE, to the closest displaced point, is none. pycpd is run up to 2000 points.
"""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import time
from typing import Any

import numpy as np
import pandas as pd
from quick_budget import parsed

from registration.cpd import CoherentPointDrift
from registration.deformable.point_drift import PointResiduals
from registration.metrics.surface_distance import rms
from registration.phantom.designed_shapes import DESIGNS
from registration.phantom.shapes import surround
from registration.rigid.icp.correspondence import TreeTarget

BEND_MM, NOISE_MM = 3.1, 0.3
PYCPD_POINTS = 2000
# The same width and roughness for both drifts; 50 iterations, as many as rustcpd was looked at with.
DRIFT = PointResiduals(beta_mm=10.0, roughness_per_mm2=2.0, rank=100, max_iterations=50, tolerance=1e-12)
METHODS = ("plane", "rustcpd", "pycpd")


def clouds(points: int) -> tuple[np.ndarray, np.ndarray, Any]:
    """The model's points, swept ones, and the motion between them."""
    tube = surround(DESIGNS["artery"]())
    rng = np.random.default_rng(0)
    model_mm, wall_mm = tube.sample(points, rng), tube.sample(points, rng)
    centre_mm = tube.vertices_mm.mean(axis=0)
    axes = np.linalg.svd(tube.vertices_mm - centre_mm, full_matrices=False)[2]
    half_mm = np.abs((tube.vertices_mm - centre_mm) @ axes[0]).max()

    def motion(points_mm: np.ndarray) -> np.ndarray:
        along = (points_mm - centre_mm) @ axes[0] / half_mm
        return BEND_MM * np.outer(np.cos(np.pi * along), axes[1])

    return model_mm, wall_mm + motion(wall_mm) + NOISE_MM * rng.standard_normal(wall_mm.shape), motion


def measure(method: str, points: int, pipe: Any) -> None:
    """Register in this process, and send what it took and left."""
    model_mm, swept_mm, motion = clouds(points)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    begun = time.perf_counter()
    if method == "pycpd":
        from pycpd import DeformableRegistration

        moved_mm = DeformableRegistration(
            X=swept_mm, Y=model_mm, beta=DRIFT.beta_mm, alpha=DRIFT.roughness_per_mm2, w=DRIFT.outlier_weight,
            max_iterations=DRIFT.max_iterations, tolerance=1e-12,
        ).register()[0]  # fmt: skip
    else:
        drift = CoherentPointDrift() if method == "plane" else CoherentPointDrift("point", point=DRIFT)
        moved_mm = drift(model_mm, swept_mm).moved_mm
    seconds = time.perf_counter() - begun
    more = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    pipe.send(
        {
            "points": points,
            "method": method,
            "seconds": seconds,
            "more_memory_mb": more / 1024,
            "rmse_mm": rms(TreeTarget(moved_mm).distances_mm(swept_mm)),
            "true_error_mm": rms(np.linalg.norm(moved_mm - model_mm - motion(model_mm), axis=1)),
        }
    )


def main() -> None:
    """Run every method on every size and print the table and the exponents of growth."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--points", default="2000,3000,10000,50000", help="sizes of both clouds")
    given = parsed(parser, {"points": "500"})
    context, rows = multiprocessing.get_context("spawn"), []
    for points in (int(size) for size in given.points.split(",")):
        for method in METHODS:
            if method == "pycpd" and points > PYCPD_POINTS:
                continue
            ours, theirs = context.Pipe(duplex=False)
            process = context.Process(target=measure, args=(method, points, theirs))
            process.start()
            theirs.close()
            try:
                rows.append(ours.recv())
            except EOFError:
                print(f"{method}, {points} points: no result (is it installed?)")
            process.join()
    table = pd.DataFrame(rows)
    print(table.to_string(index=False, float_format="%.3f"))
    for method, own in table.groupby("method", sort=False):
        if len(own) > 1:
            growth = np.polyfit(np.log(own["points"]), np.log(own["seconds"]), 1)[0]
            print(f"{method}: seconds grow as points to the power of {growth:.2f}")


if __name__ == "__main__":
    main()
