"""How near reconstructions and centerlines come to what is known, and how long each stage takes.

    python scripts/bench_reconstruction.py FOLDER [--frames 200] [--size-px 512]

FOLDER holds aorta-surface.stl, aorta-surface-open-ends.stl and aorta-centerline.vtp of VMTK's test data.
"""

from __future__ import annotations

import argparse
import resource
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from registration import frames
from registration.centerline import CenterlineExtractor
from registration.cloud_filters import StatisticalOutlierRemoval, VoxelDownsampling
from registration.clouds import OrientedCloud
from registration.contours import ContourExtractor
from registration.geometry import Centerline, Mesh, Polyline
from registration.geometry_io import read_centerline, read_surface
from registration.mesh_quality import mesh_quality
from registration.metrics import SurfaceDistance
from registration.phantom.acoustics import Scanner
from registration.phantom.conditions import Deformation, Motion
from registration.phantom.settings import PhantomSettings
from registration.phantom.simulator import SweepSimulator
from registration.phantom.slicing import cut, rasterise
from registration.phantom.trajectory import disturb
from registration.smoothing import TaubinSmoothing
from registration.surface import PoissonSurface, SurfaceMethod
from registration.surface_volume import SignedDistanceSurface

POISSON = PoissonSurface(cell_mm=0.7, bridge_mm=3.0)
# A holder keeps the probe this far from the flange whose pose is recorded.
LEVER_MM = 150.0


@dataclass(frozen=True)
class Sweep:
    """Exact masks, the frames' true and noisy transforms, and the surface behind them, all in one frame."""

    masks: np.ndarray
    true: np.ndarray
    noisy: np.ndarray
    truth: Mesh


def main() -> None:
    """Run all parts and print them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--size-px", type=int, default=512)
    given = parser.parse_args()
    centerline_beside_vmtk(given.folder)
    open_ends(given.folder)
    sweep = simulated(given.folder / "aorta-surface.stl", given.frames, given.size_px)
    accuracy(sweep)
    stages(sweep)


def centerline_beside_vmtk(folder: Path) -> None:
    """The aorta's centerline, between VMTK's ends and between those found, line by line."""
    reference = read_centerline(folder / "aorta-centerline.vtp")
    tips_mm = [line.points_mm[-1] for line in reference.lines]
    ends_mm = np.stack([reference.lines[0].points_mm[0], *tips_mm])
    closed = _mesh(folder / "aorta-surface.stl")
    opened = _mesh(folder / "aorta-surface-open-ends.stl")
    print("aorta's centerline against VMTK's (mm), where both run:")
    for name, surface, ends in (
        ("closed, ends given", closed, ends_mm),
        ("open ends, found", opened, None),
        ("closed, ends found", closed, None),
    ):
        begin_s = time.perf_counter()
        found = CenterlineExtractor()(surface, ends)
        seconds = time.perf_counter() - begin_s
        for number, theirs in enumerate(reference.lines):
            print(f"  {name:20s} line {number}: {_beside(found, theirs)}  {seconds:.2f} s for all")


def _beside(found: Centerline, theirs: Polyline) -> str:
    ours = min(found.lines, key=lambda line: float(np.linalg.norm(line.points_mm[-1] - theirs.points_mm[-1])))
    place_mm, own_mm = np.arange(0.0, theirs.length_mm, 0.05), np.arange(0.0, ours.length_mm, 0.1)
    apart_mm, nearest = cKDTree(theirs.at(place_mm)).query(ours.at(own_mm))
    both = (nearest > 0) & (nearest < len(place_mm) - 1)
    radius_mm = np.interp(own_mm, ours.arc_mm, ours.radius_mm)
    radius_mm = np.abs(radius_mm - np.interp(place_mm, theirs.arc_mm, theirs.radius_mm)[nearest])
    whole = ours.length_mm / theirs.length_mm - 1
    shared = _stretch_mm(ours, theirs) / _stretch_mm(theirs, ours) - 1
    ends_mm = np.linalg.norm(ours.points_mm[[0, -1]] - theirs.points_mm[[0, -1]], axis=1)
    return (
        f"mean {apart_mm[both].mean():.3f}  p95 {np.percentile(apart_mm[both], 95):.3f}  "
        f"radius {radius_mm[both].mean():.3f}  length {100 * whole:+.2f} %, {100 * shared:+.2f} % where both run  "
        f"ends {ends_mm[0]:.2f} {ends_mm[1]:.2f}"
    )


def _stretch_mm(line: Polyline, other: Polyline) -> float:
    """The length of a line between the places nearest to the other's two ends."""
    arc_mm = np.arange(0.0, line.length_mm, 0.01)
    first, last = cKDTree(line.at(arc_mm)).query(other.points_mm[[0, -1]])[1]
    return float(arc_mm[last] - arc_mm[first])


def _mesh(path: Path) -> Mesh:
    surface = read_surface(path)
    if not isinstance(surface, Mesh):
        raise SystemExit(f"{path}: expected a mesh, received points alone")
    return surface


def open_ends(folder: Path) -> None:
    """Poisson surfaces of points drawn from the open aorta: closed, trimmed, and cut where the points end."""
    truth = _mesh(folder / "aorta-surface-open-ends.stl")
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(truth.triangles), 20_000, p=truth.areas_mm2 / truth.areas_mm2.sum())
    corners_mm = truth.corners_mm[chosen]
    points_mm = np.einsum("pc,pci->pi", rng.dirichlet(np.ones(3), len(chosen)), corners_mm)
    facing = np.cross(corners_mm[:, 1] - corners_mm[:, 0], corners_mm[:, 2] - corners_mm[:, 0])
    cloud = OrientedCloud(points_mm, facing / np.linalg.norm(facing, axis=1, keepdims=True))
    print("open ends of the aorta (mm): greatest distance to the truth, and from the truth (what was lost)")
    for name, method in (
        ("Poisson as it is", PoissonSurface(0.7, 0.0)),
        ("a tenth trimmed", PoissonSurface(0.7, 0.0, trim_share=0.1)),
        ("cut at the points", POISSON),
    ):
        there_mm, back_mm = _both_ways(method(cloud), truth, np.ones(20_000, dtype=bool))
        print(f"  {name:20s} {there_mm.max():.2f}  {back_mm.max():.2f}")


def simulated(path: Path, count: int, size_px: int) -> Sweep:
    """Masks of a sweep over a closed mesh that does not deform; poses true and with the simulator's default noise."""
    motion = Motion(frames=count, length_mm=95.0)
    settings = PhantomSettings(
        mesh=str(path),
        scanner=Scanner(height_px=size_px, width_px=size_px),
        motion=motion,
        deformation=Deformation(bend_mm=0.0, pressure_mm=0.0),
    )
    maker = SweepSimulator(settings, 0)
    beams = maker.imager.beams
    corner_mm = np.array([axis[0, 0] for axis in beams.pixel_places_mm])
    masks = []
    for number in range(count):
        segments_mm = cut(maker.view(number).pressed(maker.bent_surface_mm), maker.anatomy.surface.triangles)
        shown_px = (beams.displayed(segments_mm) - corner_mm) / settings.scanner.pixel_mm
        masks.append(rasterise(shown_px, size_px, size_px) & beams.seen)
    bed_T_probe = maker.path.at(maker.frame_times_s)
    ee_T_probe = frames.translation((0.0, 0.0, LEVER_MM))
    bed_T_ee = bed_T_probe @ frames.invert_rigid(ee_T_probe)
    noisy = disturb(bed_T_ee, motion.noise_mm, motion.noise_deg, np.random.default_rng(0)) @ ee_T_probe
    return Sweep(
        np.stack(masks), bed_T_probe @ beams.probe_A_pixel, noisy @ beams.probe_A_pixel, maker.anatomy.surface
    )


def accuracy(sweep: Sweep) -> None:
    """Surfaces from exact masks against the surface that was swept."""
    print(f"aorta from {len(sweep.masks)} exact masks (mm): to the truth, and from its covered part")
    covered = _covered(sweep, sweep.truth.sample(20_000, np.random.default_rng(2)))
    for noise, poses in (("exact poses", sweep.true), ("default noise", sweep.noisy)):
        cloud = _cloud(sweep.masks, poses)
        methods: tuple[SurfaceMethod, ...] = (POISSON, SignedDistanceSurface(cell_mm=0.6, bridge_mm=3.0))
        for method in methods:
            mesh = TaubinSmoothing()(method(cloud)).mesh
            there_mm, back_mm = _both_ways(mesh, sweep.truth, covered)
            quality = mesh_quality(mesh)
            print(
                f"  {noise:14s} {type(method).__name__:22s} mean {there_mm.mean():.3f}  {back_mm.mean():.3f}  "
                f"HD95 {max(np.percentile(there_mm, 95), np.percentile(back_mm, 95)):.3f}  "
                f"open ends {quality.open_ends}  holes {quality.holes}"
            )


def stages(sweep: Sweep) -> None:
    """Seconds from masks to smoothed surface and centerline, stage by stage, and the peak of memory so far."""
    times_s, begin_cpu_s = {"start": time.perf_counter()}, time.process_time()
    contours = ContourExtractor()(sweep.masks, sweep.noisy)
    times_s["contours"] = time.perf_counter()
    thinned = VoxelDownsampling(0.4)(contours)
    cloud = StatisticalOutlierRemoval(16, 4.0)(thinned.cloud)
    times_s["filters"] = time.perf_counter()
    mesh = POISSON(cloud.cloud)
    times_s["surface"] = time.perf_counter()
    smooth = TaubinSmoothing()(mesh)
    times_s["smoothing"] = time.perf_counter()
    CenterlineExtractor()(smooth.mesh)
    times_s["centerline"] = time.perf_counter()
    shape = " x ".join(str(size) for size in sweep.masks.shape)
    print(f"from {shape} masks: {len(contours)} points, {len(thinned.removed)} thinned, ", end="")
    print(f"{len(cloud.removed)} outliers, {len(mesh.triangles)} triangles, ", end="")
    print(f"smoothing changed the volume by {100 * smooth.volume_change:+.2f} %")
    ends_s = list(times_s.values())
    for stage, seconds in zip(list(times_s)[1:], np.diff(ends_s), strict=True):
        print(f"  {stage:12s} {seconds:.2f} s")
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    cpu_s = time.process_time() - begin_cpu_s
    print(f"  {'all':12s} {ends_s[-1] - ends_s[0]:.2f} s ({cpu_s:.2f} s of processor time), ", end="")
    print(f"at most {peak_mb:.0f} MB in the process")


def _cloud(masks: np.ndarray, poses: np.ndarray) -> OrientedCloud:
    thinned = VoxelDownsampling(0.4)(ContourExtractor()(masks, poses)).cloud
    return StatisticalOutlierRemoval(16, 4.0)(thinned).cloud


def _covered(sweep: Sweep, points_mm: np.ndarray) -> np.ndarray:
    """Which points lie between the first and the last frame."""
    middle_mm = sweep.truth.vertices_mm.mean(axis=0)
    between = np.ones(len(points_mm), dtype=bool)
    for pose in sweep.true[[0, -1]]:
        normal = np.cross(pose[:3, 0], pose[:3, 1])
        between &= ((points_mm - pose[:3, 3]) @ normal) * ((middle_mm - pose[:3, 3]) @ normal) >= 0
    return between


def _both_ways(mesh: Mesh, truth: Mesh, covered: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    there_mm = SurfaceDistance(truth)(mesh.sample(20_000, np.random.default_rng(1)))
    return there_mm, SurfaceDistance(mesh)(truth.sample(20_000, np.random.default_rng(2))[covered])


if __name__ == "__main__":
    main()
