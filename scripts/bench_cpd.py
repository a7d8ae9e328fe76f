"""Deformable registration of a bent tube by size: ours along the wall, rustcpd, and other programs where they are.

    python scripts/bench_cpd.py [--points 2000,10000] [--bcpd PATH] [--quick]

A designed artery is bent by 3.1 mm; both clouds are drawn apart from each other, the swept one with noise of 0.3 mm.
All methods get the same clouds in the same minute, each in a process of its own for its peak memory. The true error is
that of material points; RMSE, of the swept points to the closest displaced one, and HD95, both ways, are none. pycpd
(up to 2000 points) and rcpd (up to 10,000) are run where they are installed, BCPD where its program is given.
"""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import time
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from quick_budget import parsed

from registration.benchmark.drift_comparators import drift_by_bcpd, drift_by_pycpd, drift_by_rcpd
from registration.cpd import CoherentPointDrift
from registration.deformable.point_drift import PointResiduals
from registration.errors import InputError
from registration.metrics.surface_distance import rms
from registration.phantom.designed_shapes import DESIGNS
from registration.phantom.shapes import surround
from registration.rigid.icp.correspondence import TreeTarget

BEND_MM, NOISE_MM = 3.1, 0.3
# Larger clouds are left out, to keep the time of all sizes within an hour.
LARGEST = {"pycpd": 2000, "rcpd": 10_000}
# The same width and roughness for both drifts; 50 iterations, as many as rustcpd was looked at with.
DRIFT = PointResiduals(beta_mm=10.0, roughness_per_mm2=2.0, rank=100, max_iterations=50, tolerance=1e-12)
METHODS = ("plane", "rustcpd", "pycpd", "rcpd", "bcpd")


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


def moved(method: str, model_mm: np.ndarray, swept_mm: np.ndarray, bcpd: Path | None) -> np.ndarray:
    """The model's points as a method displaces them."""
    if method == "pycpd":
        return drift_by_pycpd(model_mm, swept_mm, DRIFT)
    if method == "rcpd":
        return drift_by_rcpd(model_mm, swept_mm, DRIFT)
    if bcpd is not None and method == "bcpd":
        return drift_by_bcpd(bcpd, model_mm, swept_mm, DRIFT)
    drift = CoherentPointDrift() if method == "plane" else CoherentPointDrift("point", point=DRIFT)
    return drift(model_mm, swept_mm).moved_mm


def measure(method: str, points: int, bcpd: Path | None, pipe: Any) -> None:
    """Register in this process, and send what it took and left, or a sentence why there is nothing."""
    model_mm, swept_mm, motion = clouds(points)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    begun = time.perf_counter()
    try:
        moved_mm = moved(method, model_mm, swept_mm, bcpd)
    except InputError as refusal:
        pipe.send(str(refusal))
        return
    seconds = time.perf_counter() - begun
    more = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    # Of a program of its own all memory counts.
    more += resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    there_mm, back_mm = (
        TreeTarget(moved_mm).distances_mm(swept_mm),
        TreeTarget(swept_mm).distances_mm(moved_mm),
    )
    pipe.send(
        {
            "points": points,
            "method": method,
            "seconds": seconds,
            "more_memory_mb": more / 1024,
            "rmse_mm": rms(there_mm),
            "hd95_mm": max(float(np.percentile(each_mm, 95)) for each_mm in (there_mm, back_mm)),
            "true_error_mm": rms(np.linalg.norm(moved_mm - model_mm - motion(model_mm), axis=1)),
        }
    )


def main() -> None:
    """Run every method on every size and print the table and the exponents of growth."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--points", default="2000,3000,10000,50000", help="sizes of both clouds")
    parser.add_argument(
        "--bcpd", type=Path, help="the program of Bayesian Coherent Point Drift (ohirose/bcpd)"
    )
    given = parsed(parser, {"points": "500"})
    context, rows = multiprocessing.get_context("spawn"), []
    methods = [method for method in METHODS if method != "bcpd" or given.bcpd is not None]
    for points in (int(size) for size in given.points.split(",")):
        for method in [one for one in methods if points <= LARGEST.get(one, points)]:
            ours, theirs = context.Pipe(duplex=False)
            process = context.Process(target=measure, args=(method, points, given.bcpd, theirs))
            process.start()
            theirs.close()
            try:
                found = ours.recv()
            except EOFError:
                found = "ended without a result"
            process.join()
            if isinstance(found, dict):
                rows.append(found)
                continue
            print(f"{method}, {points} points: {found}")
            methods.remove(method)
    table = pd.DataFrame(rows)
    print(table.to_string(index=False, float_format="%.3f"))
    for method, own in table.groupby("method", sort=False):
        if len(own) > 1:
            growth = np.polyfit(np.log(own["points"]), np.log(own["seconds"]), 1)[0]
            print(f"{method}: seconds grow as points to the power of {growth:.2f}")


if __name__ == "__main__":
    main()
