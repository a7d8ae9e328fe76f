"""Seconds a trial of the multi-start registration next to one run of Open3D's ICP, on the same problems, in turn."""

from __future__ import annotations

import os

# Read by the numerical libraries when they are imported: one core for everybody.
os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")

import argparse
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import open3d as o3d
from quick_budget import parsed

from registration.geometry.shapes import Mesh
from registration.io.surfaces import read_surface
from registration.metrics.surface_distance import SUCCESS_TRE_MM, pose_error
from registration.perturbation.perturbation import Perturbation, Piece, Trial
from registration.phantom.designed_shapes import DESIGNS
from registration.phantom.shapes import surround
from registration.rigid.comparators import GeneralisedICP
from registration.rigid.multi_start import MultiStartICP

PIECES = (Piece(), Piece(0.6, "middle"), Piece(0.4, "start"), Piece(0.4, "end"))


def open3d_icp(plane: bool) -> Callable[[Trial], np.ndarray]:
    """Open3D's single-start ICP from where the clouds lie, without a limit on distance that would need tuning."""
    parts = o3d.pipelines.registration

    def register(trial: Trial) -> np.ndarray:
        moving, fixed = (
            o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points_mm))
            for points_mm in (trial.moving_mm, trial.fixed_mm)
        )
        if plane:
            fixed.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(20))
        step = (
            parts.TransformationEstimationPointToPlane()
            if plane
            else parts.TransformationEstimationPointToPoint()
        )
        stop = parts.ICPConvergenceCriteria(max_iteration=100)
        return np.asarray(
            parts.registration_icp(moving, fixed, 1e3, np.eye(4), step, stop).transformation
        ).copy()

    return register


def perturbation(noise_mm: float) -> Perturbation:
    """3000 points of a piece of the vessel, turned and moved by any pose, to 5000 of the whole."""
    return Perturbation(180.0, 50.0, noise_mm, 0.0, 3000, 5000)


def methods() -> dict[str, Callable[[Trial], np.ndarray]]:
    """The poses that each method finds; ours is the first."""
    ours, generalised = MultiStartICP(), GeneralisedICP(1e3, 1e-3)
    return {
        "multistart": lambda trial: ours(trial.moving_mm, trial.fixed_mm).fixed_T_moving,
        "Open3D point-to-point": open3d_icp(plane=False),
        "Open3D point-to-plane": open3d_icp(plane=True),
        "small_gicp GICP": lambda trial: generalised(trial.moving_mm, trial.fixed_mm).fixed_T_moving,
    }


def main() -> None:
    """Time both methods in turns and print medians and their ratio."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "surface", nargs="?", type=Path, help="a vessel's surface; none: the simulator's artery"
    )
    parser.add_argument("--trials", type=int, default=10, help="problems a piece")
    parser.add_argument("--noise", type=float, default=0.5, help="mm, on both clouds")
    given = parsed(parser, {"trials": 1})
    surface = read_surface(given.surface) if given.surface else surround(DESIGNS["artery"]())
    if not isinstance(surface, Mesh):
        raise SystemExit(f"surface: expected triangles in {given.surface}, received points alone")
    targets_mm = surface.sample(500, np.random.default_rng(0))
    tried, drawn = methods(), perturbation(given.noise)
    seconds: dict[str, list[float]] = {name: [] for name in tried}
    errors_mm: dict[str, list[float]] = {name: [] for name in tried}
    for piece in PIECES:
        for number in range(given.trials):
            trial = drawn(surface, surface, np.eye(4), piece, seed=1, trial=number)
            for name, method in tried.items():
                begin = time.perf_counter()
                pose = method(trial)
                seconds[name].append(time.perf_counter() - begin)
                errors_mm[name].append(pose_error(pose, trial.fixed_T_moving, targets_mm).tre_mm)
    ratio = [
        one / peer for one, peer in zip(seconds["multistart"], seconds["Open3D point-to-point"], strict=True)
    ]
    print(
        f"3000 points to 5000, one core, {len(PIECES)} pieces x {given.trials} poses, noise {given.noise:g} mm"
    )
    for name in tried:
        found = sum(error <= SUCCESS_TRE_MM for error in errors_mm[name])
        print(
            f"{name:22} {statistics.median(seconds[name]):.3f} s a trial (median), "
            f"{found} of {len(errors_mm[name])} within {SUCCESS_TRE_MM:g} mm"
        )
    print(f"multistart / Open3D point-to-point: {statistics.median(ratio):.2f} (median of pairs)")


if __name__ == "__main__":
    main()
