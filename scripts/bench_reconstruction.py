"""How near reconstructions and centerlines come to what is known, and how long each stage takes.

    python scripts/bench_reconstruction.py [FOLDER] [--frames 200] [--size-px 512] [--model MODEL.PT] [--quick]

FOLDER holds aorta-surface.stl, aorta-surface-open-ends.stl and aorta-centerline.vtp of VMTK's test data (by default
../shared/data/vmtk, or vmtk in CTUS_TEST_DATA). With a network (model.pt), pictures of the sweep are made and the masks
that the network finds in them are reconstructed too.
"""

from __future__ import annotations

import argparse
import resource
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from bench_centerline import (
    NOISE_MM,
    Reference,
    centerlines_compared_with_vmtk,
    heading,
    line_distances_mm,
    meshes,
    row,
)
from quick_budget import data_folder, parsed

from registration import transforms
from registration.centerline.extractor import CenterlineExtractor
from registration.geometry.mesh_quality import mesh_quality
from registration.geometry.point_cloud import OrientedCloud
from registration.geometry.shapes import Mesh
from registration.metrics.surface_distance import SurfaceDistance
from registration.phantom.acoustics import Scanner
from registration.phantom.conditions import Deformation, Motion
from registration.phantom.settings import PhantomSettings
from registration.phantom.simulator import SweepSimulator
from registration.phantom.trajectory import disturb
from registration.reconstruction.contours import ContourExtractor
from registration.reconstruction.outlier_filters import (
    RadiusOutlierRemoval,
    StatisticalOutlierRemoval,
    VoxelDownsampling,
)
from registration.reconstruction.signed_distance import SignedDistanceSurface
from registration.reconstruction.surface import PoissonSurface, SurfaceMethod
from registration.reconstruction.taubin import TaubinSmoothing

POISSON = PoissonSurface(cell_mm=0.7, bridge_mm=3.0)
# Pictures for a network take longer than masks: fewer and smaller ones.
PICTURES, PICTURE_PX = 100, 256
LENGTH_MM = 95.0
# A holder keeps the probe this far from the flange whose pose is recorded.
LEVER_MM = 150.0


@dataclass(frozen=True)
class Sweep:
    """Exact masks, the frames' true and noisy transforms, the surface behind them and VMTK's lines, in one frame."""

    masks: np.ndarray
    true: np.ndarray
    noisy: np.ndarray
    truth: Mesh
    reference: Reference


def main() -> None:
    """Run all parts and print them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path)
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--size-px", type=int, default=512)
    parser.add_argument("--model", type=Path)
    given = parsed(parser, {"frames": 120, "size_px": 128})
    folder = data_folder(given.folder, "vmtk")
    if folder is None:
        return
    if not given.quick:
        centerlines_compared_with_vmtk(folder)
    open_ends(folder)
    sweep = simulated(folder, aorta(folder, given.frames, given.size_px))
    accuracy(sweep)
    swept_centerlines(sweep)
    stages(sweep)
    if given.model is not None:
        network_masks(folder, given.model)


def open_ends(folder: Path) -> None:
    """Poisson surfaces of points drawn from the open aorta: closed, trimmed, and cut where the points end."""
    truth = meshes(folder)[1]
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


def aorta(folder: Path, count: int, size_px: int) -> SweepSimulator:
    """A sweep along the closed aorta, which does not deform."""
    settings = PhantomSettings(
        mesh=str(folder / "aorta-surface.stl"),
        scanner=Scanner(height_px=size_px, width_px=size_px),
        motion=Motion(frames=count, length_mm=LENGTH_MM),
        deformation=Deformation(bend_mm=0.0, pressure_mm=0.0),
    )
    return SweepSimulator(settings, 0)


def simulated(folder: Path, maker: SweepSimulator) -> Sweep:
    """The exact masks of a sweep; poses true and with the simulator's default noise."""
    motion, beams = maker.settings.motion, maker.imager.beams
    masks = np.stack([maker.mask(maker.view(number)) for number in range(motion.frames)])
    bed_T_probe = maker.path.at(maker.frame_times_s)
    ee_T_probe = transforms.translation((0.0, 0.0, LEVER_MM))
    bed_T_ee = bed_T_probe @ transforms.invert_rigid(ee_T_probe)
    noisy = disturb(bed_T_ee, motion.noise_mm, motion.noise_deg, np.random.default_rng(0)) @ ee_T_probe
    bed_T_ct = transforms.invert_rigid(maker.anatomy.ct_T_bed)
    reference = Reference.of(folder, meshes(folder)[0]).moved(
        lambda points_mm: transforms.apply(bed_T_ct, points_mm)
    )
    return Sweep(
        masks,
        bed_T_probe @ beams.probe_A_pixel,
        noisy @ beams.probe_A_pixel,
        maker.anatomy.surface,
        reference,
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


def swept_centerlines(sweep: Sweep) -> None:
    """The centerline of a swept surface next to VMTK's: all frames, 30 % of them missing, and noise on the points."""
    heading()
    rng = np.random.default_rng(0)
    kept = np.sort(rng.permutation(len(sweep.masks))[: round(0.7 * len(sweep.masks))])
    cloud = _cloud(sweep.masks, sweep.noisy)
    shifted = replace(cloud, points_mm=cloud.points_mm + rng.normal(0, NOISE_MM, cloud.points_mm.shape))
    for name, points in (
        ("sweep, all frames", cloud),
        ("sweep, 30 % missing", _cloud(sweep.masks[kept], sweep.noisy[kept])),
        (f"sweep, {NOISE_MM} mm noise", shifted),
    ):
        row(name, TaubinSmoothing()(POISSON(points)).mesh, sweep.reference)


def network_masks(folder: Path, model: Path) -> None:
    """Surfaces and centerlines from a network's masks next to those from exact masks of the same frames."""
    from models.predictor import Predictor

    maker = aorta(folder, PICTURES, PICTURE_PX)
    sweep = simulated(folder, maker)
    pictures = np.stack([maker.frame(number, maker.view(number))[0] for number in range(PICTURES)])
    found = Predictor.load(model)(pictures)
    both = (found & sweep.masks).sum(axis=(1, 2))
    dsc = 2 * both / np.maximum(found.sum(axis=(1, 2)) + sweep.masks.sum(axis=(1, 2)), 1)
    covered = _covered(sweep, sweep.truth.sample(20_000, np.random.default_rng(2)))
    print(f"aorta from {PICTURES} pictures of {PICTURE_PX} px, poses with default noise; ", end="")
    print(f"network's DSC mean {dsc.mean():.3f}, least {dsc.min():.3f} (mm, to the truth and from it)")
    for name, masks in (("exact masks", sweep.masks), ("network's masks", found)):
        cloud = RadiusOutlierRemoval(2.0, 4)(_cloud(masks, sweep.noisy)).cloud
        mesh = TaubinSmoothing(volume_tolerance=0.1)(POISSON(cloud)).mesh
        there_mm, back_mm = _both_ways(mesh, sweep.truth, covered)
        lines = CenterlineExtractor()(mesh)
        line_there_mm, line_back_mm = line_distances_mm(lines, sweep.reference)
        print(f"  {name:16s} surface mean {there_mm.mean():.3f}  {back_mm.mean():.3f}  HD95 ", end="")
        print(f"{np.percentile(there_mm, 95):.3f}  {np.percentile(back_mm, 95):.3f}")
        print(f"  {'':16s} {len(lines.lines)} lines, mean {line_there_mm.mean():.3f}  ", end="")
        print(f"{line_back_mm.mean():.3f}  p95 {np.percentile(line_there_mm, 95):.3f}  ", end="")
        print(f"{np.percentile(line_back_mm, 95):.3f}")


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
