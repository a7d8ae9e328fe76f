"""What is claimed of the speed of surfaces and their registration, each with its peers."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from side_by_side import MIN_ROUNDS, Claim, Side, installed, missing, version_of

COVERED_SAMPLES = 20_000


def drift(quick: bool) -> Claim:
    """Deformable registration of 2000 points beside the fast implementations of Coherent Point Drift."""
    from bench_cpd import DRIFT

    from registration.benchmark.drift_comparators import drift_by_rcpd
    from registration.deformable.point_drift import drift_points

    def by_rustcpd(problem: Bent) -> np.ndarray:
        return problem.model_mm + drift_points(problem.model_mm, problem.swept_mm, DRIFT).field(
            problem.model_mm
        )

    peers = [Side("Coherent Point Drift, low rank and 10 neighbours", by_rustcpd, version_of("rustcpd"))]
    remarks = [DRIFT_REMARK]
    if installed("rcpd"):
        call = lambda problem: drift_by_rcpd(problem.model_mm, problem.swept_mm, DRIFT)  # noqa: E731
        peers.append(Side("Coherent Point Drift, 100 modes", call, version_of("rcpd")))
    else:
        remarks.append(missing("rcpd", "rcpd"))
    return _drift_claim("Deformable registration", 300 if quick else 2000, peers, remarks, 5)


def drift_small(quick: bool) -> Claim:
    """The same with as few points as pycpd, which uses all pairs, takes in a reasonable time."""
    from bench_cpd import DRIFT

    from registration.benchmark.drift_comparators import drift_by_pycpd

    peers, remarks = [], [DRIFT_REMARK]
    if installed("pycpd"):
        call = lambda problem: drift_by_pycpd(problem.model_mm, problem.swept_mm, DRIFT)  # noqa: E731
        peers.append(Side("Coherent Point Drift, all pairs", call, version_of("pycpd")))
    else:
        remarks.append(missing("pycpd", "pycpd"))
    return _drift_claim("Deformable registration, few points", 200 if quick else 1000, peers, remarks, 3)


DRIFT_REMARK = (
    "Not one algorithm: ours takes distances along the wall and predicts its error too, the peers are the textbook's "
    "drift, 50 iterations at most, the same kernel and weight. The error is that of material points, which both are "
    "after."
)


@dataclass(frozen=True)
class Bent:
    """A model, what was swept of it after it was bent, and where the model's points went, all in mm."""

    model_mm: np.ndarray
    swept_mm: np.ndarray
    truth_mm: np.ndarray


def _drift_claim(title: str, points: int, peers: list[Side], remarks: list[str], rounds: int) -> Claim:
    from bench_cpd import BEND_MM, NOISE_MM, clouds, rms

    from registration.cpd import CoherentPointDrift

    model_mm, swept_mm, motion = clouds(points)
    bent = Bent(model_mm, swept_mm, model_mm + motion(model_mm))
    before_mm = rms(np.linalg.norm(bent.truth_mm - model_mm, axis=1))
    ours = CoherentPointDrift()
    return Claim(
        title,
        f"an artery bent by {BEND_MM} mm, {points} points to {points} others with {NOISE_MM} mm of noise",
        Side("deformable=cpd", lambda problem: ours(problem.model_mm, problem.swept_mm).moved_mm),
        lambda problem, moved_mm: rms(np.linalg.norm(moved_mm - problem.truth_mm, axis=1)),
        f"true error of material points, mm; half of the {before_mm:.2f} before are right",
        0.5 * before_mm,
        peers,
        lambda number: bent,
        rounds,
        warm_up=rounds > MIN_ROUNDS,
        remarks=remarks,
    )


def rigid(quick: bool) -> Claim:
    """The multi-start beside one run of ICP, and beside methods that search by features."""
    from bench_rigid import PIECES, methods, perturbation

    from registration.metrics.surface_distance import SUCCESS_TRE_MM, pose_error
    from registration.phantom.designed_shapes import DESIGNS
    from registration.phantom.shapes import surround

    surface = surround(DESIGNS["artery"]())
    targets_mm = surface.sample(500, np.random.default_rng(0))
    drawn = perturbation(0.5)
    tried = methods()
    remarks = [
        "ICP from one start does less, and finds the pose only where that start is near: see its rounds that are right."
    ]
    peers = [
        Side(name, call, version_of("small_gicp" if "GICP" in name else "open3d"))
        for name, call in tried.items()
        if name != "multistart"
    ]
    peers += _by_features(remarks)
    return Claim(
        "Rigid registration from anywhere",
        "3000 points of an artery (whole, 60 and 40 % of it) to 5000, 0.5 mm of noise, turned by up to 180 degrees",
        Side("rigid=multistart", tried["multistart"]),
        lambda trial, pose: pose_error(pose, trial.fixed_T_moving, targets_mm).tre_mm,
        "TRE, mm",
        SUCCESS_TRE_MM,
        peers,
        # Another pose each round: trials of one number have the same for every piece.
        lambda number: drawn(surface, surface, np.eye(4), PIECES[number % len(PIECES)], seed=1, trial=number),
        1 if quick else 16,
        remarks=remarks,
    )


def _by_features(remarks: list[str]) -> list[Side]:
    """FPFH with RANSAC and fast global registration, and KISS-Matcher, each refined by point-to-plane ICP."""
    from registration.rigid.comparators import FpfhFastGlobal, FpfhFeatures, FpfhRansac, KissMatcher

    def side(name: str, method: Callable[..., Any], package: str) -> Side:
        call = lambda trial: method(trial.moving_mm, trial.fixed_mm).fixed_T_moving  # noqa: E731
        return Side(f"{name}, then point-to-plane ICP", call, version_of(package))

    features = FpfhFeatures(2.0, 12.0)
    found = [
        side("FPFH + RANSAC", FpfhRansac(features, 3.0), "open3d"),
        side("FPFH + fast global registration", FpfhFastGlobal(features, 3.0), "open3d"),
    ]
    if installed("kiss-matcher"):
        return [*found, side("KISS-Matcher", KissMatcher(1.5), "kiss-matcher")]
    remarks.append(missing("kiss-matcher", "KISS-Matcher"))
    return found


def mesh_distance(quick: bool) -> Claim:
    """Distances of points to a mesh, beside VTK."""
    import vtkmodules.all as vtk
    from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy

    from registration.metrics.surface_distance import SurfaceDistance
    from registration.phantom.designed_shapes import DESIGNS
    from registration.phantom.shapes import surround

    surface = surround(DESIGNS["artery"]())
    count, rng = 1000 if quick else 20_000, np.random.default_rng(0)
    points_mm = surface.sample(count, rng) + rng.normal(0.0, 2.0, (count, 3))
    first = points_mm[:200]
    exact_mm = np.array([_exact_mm(surface.corners_mm, point_mm) for point_mm in first])

    body = _polydata(surface)

    def by_vtk(points_mm: np.ndarray) -> np.ndarray:
        distance = vtk.vtkImplicitPolyDataDistance()
        distance.SetInput(body)
        found = vtk.vtkDoubleArray()
        distance.FunctionValue(numpy_to_vtk(points_mm), found)
        return np.abs(vtk_to_numpy(found))

    return Claim(
        "Distance of points to a mesh",
        f"{count} points within some mm of an artery of {len(surface.triangles)} triangles, the search tree included",
        Side("SurfaceDistance", lambda points_mm: SurfaceDistance(surface)(points_mm)),
        lambda _, found_mm: np.abs(found_mm[: len(first)] - exact_mm).max(),
        f"greatest difference from all triangles tried one by one, {len(first)} points, mm",
        1e-3,
        [
            Side(
                "vtkImplicitPolyDataDistance (signed, double precision)",
                by_vtk,
                f"vtk {vtk.vtkVersion.GetVTKVersion()}",
            )
        ],
        lambda number: points_mm,
        1 if quick else 5,
        remarks=["Ours computes in single precision and without a sign."],
    )


def _polydata(surface: Any) -> Any:
    """A mesh as VTK has it, by way of a file."""
    from vtkmodules.vtkIOPLY import vtkPLYReader

    from registration.io.surfaces import write_surface

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "surface.ply"
        write_surface(path, surface)
        reader = vtkPLYReader()
        reader.SetFileName(str(path))
        reader.Update()
        return reader.GetOutput()


def _exact_mm(corners_mm: np.ndarray, point_mm: np.ndarray) -> float:
    """Least distance of a point to triangles: to the plane where it falls inside, else to the nearest edge."""
    a, b, c = (corners_mm[:, corner] for corner in range(3))
    normal = np.cross(b - a, c - a)
    size = np.linalg.norm(normal, axis=1)
    normal, kept = normal / np.maximum(size, 1e-30)[:, None], size > 0
    height = ((point_mm - a) * normal).sum(axis=1)
    foot = point_mm - height[:, None] * normal
    inside = kept.copy()
    nearest_mm = np.full(len(a), np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        edge = end - start
        inside &= (np.cross(edge, foot - start) * normal).sum(axis=1) >= 0
        along = ((point_mm - start) * edge).sum(axis=1) / np.maximum((edge**2).sum(axis=1), 1e-30)
        at = start + np.clip(along, 0, 1)[:, None] * edge
        nearest_mm = np.minimum(nearest_mm, np.linalg.norm(point_mm - at, axis=1))
    return float(np.where(inside, np.abs(height), nearest_mm).min())


def reconstruction(quick: bool) -> Claim:
    """Masks to a smooth surface, beside a chain of scikit-image and Open3D as one would write it."""
    from bench_sweep_faults import AFTER, Sweep, simulated

    from registration.geometry.shapes import Mesh
    from registration.metrics.surface_distance import SurfaceDistance

    sweep = simulated("artery", 1, 20 if quick else 80, 2.0 if quick else 0.75)
    chain = replace(AFTER, centerline=None)

    def error_mm(problem: Sweep, surface: Mesh) -> float:
        there_mm = SurfaceDistance(problem.truth)(surface.sample(COVERED_SAMPLES, np.random.default_rng(1)))
        back_mm = SurfaceDistance(surface)(problem.truth_mm[problem.between])
        return max(float(there_mm.mean()), float(back_mm.mean()))

    height, width = sweep.masks.shape[1:]
    return Claim(
        "Reconstruction of a surface",
        f"{len(sweep.masks)} exact masks of {height} x {width} px with noisy poses to a smooth surface",
        Side("Reconstruction", lambda problem: chain(problem.masks, problem.poses).surface),
        error_mm,
        "mean distance to the true surface and from its swept part, the larger, mm",
        0.5,
        [
            Side(
                "find_contours, voxels, outliers, normals, Poisson, Taubin by hand",
                by_hand,
                f"{version_of('scikit-image')}, {version_of('open3d')}",
            )
        ],
        lambda number: sweep,
        1 if quick else 5,
        remarks=[
            "Ours also looks for masks that disagree with their neighbours and leaves the ends of the vessel open; the "
            "chain by hand takes the same cell, voxel and outlier rule, and cuts the twentieth of lowest density."
        ],
    )


def by_hand(problem: Any) -> Any:
    """The usual chain of library calls from masks and poses to a mesh.

    Parameters
    ----------
    problem : bench_sweep_faults.Sweep
        Masks and poses.

    Returns
    -------
    Mesh
        Surface in mm.
    """
    import open3d as o3d
    from skimage.measure import find_contours

    from registration.geometry.shapes import Mesh

    parts = [
        line[:, ::-1] @ pose[:3, :2].T + pose[:3, 3]
        for mask, pose in zip(problem.masks, problem.poses, strict=True)
        for line in find_contours(mask.astype(float), 0.5)
    ]
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(np.concatenate(parts)))
    cloud = cloud.voxel_down_sample(0.4).remove_statistical_outlier(16, 4.0)[0]
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(20))
    cloud.orient_normals_consistent_tangent_plane(20)
    mesh, density = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
        cloud, depth=0, width=0.7, linear_fit=True, n_threads=1
    )
    mesh.remove_vertices_by_mask(np.asarray(density) < np.quantile(density, 0.05))
    mesh = mesh.filter_smooth_taubin(10)
    return Mesh(np.array(mesh.vertices), np.array(mesh.triangles, dtype=np.int64))
