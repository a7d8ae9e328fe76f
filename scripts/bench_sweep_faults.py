"""What gaps and wrong masks in a sweep do to the reconstructed surface, with and without what is done against them.

    python scripts/bench_sweep_faults.py [--held-out] [--sweeps 6] [--frames 80] [--step-mm 0.75] [--quick]

Six simulated sweeps (anatomies for development, with --held-out others) are reconstructed clean, with one gap of 4, 8
and 16 frames, with a tenth of their masks wrong (a blob elsewhere, shifted, empty, the full frame, twice as large) and
with both. Before: all masks, and only the largest piece. After: masks that disagree left out, and all pieces of the
vessel.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace

import numpy as np
from quick_budget import parsed

from registration import transforms
from registration.centerline.extractor import CenterlineExtractor
from registration.geometry.shapes import Mesh
from registration.metrics.surface_distance import SurfaceDistance
from registration.phantom.conditions import Motion
from registration.phantom.scan import SimulatedSweep, simulate_sweep
from registration.phantom.settings import PhantomSettings
from registration.pipeline import Reconstruction
from registration.reconstruction.contours import ContourExtractor
from registration.reconstruction.mask_outliers import MaskOutliers
from registration.reconstruction.outlier_filters import (
    RadiusOutlierRemoval,
    StatisticalOutlierRemoval,
    VoxelDownsampling,
)
from registration.reconstruction.surface import PoissonSurface
from registration.reconstruction.taubin import TaubinSmoothing
from registration.synchronisation import synchronise

DEVELOPMENT = (("artery", 1), ("vein", 1), ("artificial", 1), ("random", 3), ("random", 7), ("random", 11))
HELD_OUT = (
    ("artery", 1000),
    ("vein", 1000),
    ("artificial", 1000),
    ("random", 1000),
    ("random", 1001),
    ("random", 1002),
)
GAPS = (0, 4, 8, 16)
FAULTS = ("blob", "shifted", "empty", "full", "twice")
FAULTY_SHARE = 0.1
# A place of the truth is recovered where the surface is that near.
NEAR_MM = 1.0
AFTER = Reconstruction(
    ContourExtractor(),
    {
        "voxel": VoxelDownsampling(0.4),
        "statistical": StatisticalOutlierRemoval(16, 4.0),
        "radius": RadiusOutlierRemoval(2.0, 4),
    },
    PoissonSurface(cell_mm=0.7, bridge_mm=3.0, largest=False),
    TaubinSmoothing(volume_tolerance=0.5),
    CenterlineExtractor(),
)
BEFORE = replace(
    AFTER,
    mask_outliers=MaskOutliers(enabled=False),
    surface=PoissonSurface(cell_mm=0.7, bridge_mm=3.0, largest=True),
)


@dataclass(frozen=True)
class Sweep:
    """Masks and poses of a sweep, and the vessel where it was swept, as points in the world."""

    masks: np.ndarray
    poses: np.ndarray
    truth_mm: np.ndarray
    truth: Mesh
    between: np.ndarray


def main() -> None:
    """Print a row for each sweep and fault, before and after."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--held-out", action="store_true")
    parser.add_argument("--sweeps", type=int, default=6, help="the first so many of the six")
    parser.add_argument("--frames", type=int, default=80)
    parser.add_argument("--step-mm", type=float, default=0.75)
    given = parsed(parser, {"sweeps": 1, "frames": 40, "step_mm": 1.5})
    print(
        "recovered share of the swept surface; largest and 95th percentile distance to the truth in mm; lines"
    )
    print(
        f"{'sweep':15s} {'gap':>3s} {'wrong':>5s}  {'before':^29s}  {'after':^29s}  rejected (right, false) missed"
    )
    for subset, seed in (HELD_OUT if given.held_out else DEVELOPMENT)[: given.sweeps]:
        sweep = simulated(subset, seed, given.frames, given.step_mm)
        for gap in GAPS:
            for share in (0.0, FAULTY_SHARE):
                row(f"{subset} {seed}", sweep, gap, share, seed)


def simulated(subset: str, seed: int, count: int, step_mm: float) -> Sweep:
    """One sweep, and its anatomy as it lay in the world: bent, but not pressed."""
    settings = PhantomSettings(
        subset=subset,
        seed=seed,
        anatomy_seed=seed if subset == "random" else 0,
        motion=Motion(frames=count, length_mm=step_mm * count),
    )
    found = simulate_sweep(settings, 0, pictures=False)
    posed = synchronise(found.sweep, 0.1)
    truth = _seen(found)
    points_mm = truth.sample(20_000, np.random.default_rng(0))
    inner = np.ones(len(points_mm), dtype=bool)
    for pose, other in ((posed.world_A_pixel[0], 1), (posed.world_A_pixel[-1], -1)):
        normal = np.cross(pose[:3, 0], pose[:3, 1])
        way = posed.world_A_pixel[-1, :3, 3] - posed.world_A_pixel[0, :3, 3]
        inner &= other * np.sign(normal @ way) * ((points_mm - pose[:3, 3]) @ normal) > 0
    return Sweep(found.masks[posed.kept], posed.world_A_pixel, points_mm, truth, inner)


def _seen(found: SimulatedSweep) -> Mesh:
    """The anatomy in the world, its bend undone by a few steps of a fixed point."""
    wanted_mm = found.anatomy.vertices_mm
    bent_mm = wanted_mm.copy()
    for _ in range(20):
        bent_mm = bent_mm + (wanted_mm - found.deformation.material(bent_mm))
    world_T_ct = transforms.invert_rigid(found.ct_T_world)
    return Mesh(transforms.apply(world_T_ct, bent_mm), found.anatomy.triangles)


def row(name: str, sweep: Sweep, gap: int, share: float, seed: int) -> None:
    """Measure one case both ways and print it."""
    rng = np.random.default_rng([seed, gap])
    kept = np.ones(len(sweep.masks), dtype=bool)
    if gap:
        begin = int(rng.integers(len(kept) // 4, 3 * len(kept) // 4 - gap))
        kept[begin : begin + gap] = False
    masks, wrong = spoilt(sweep.masks[kept], share, rng)
    poses = sweep.poses[kept]
    parts = [f"{name:15s} {gap:3d} {len(wrong):5d}"]
    for chain in (BEFORE, AFTER):
        try:
            found = chain(masks, poses)
        except ValueError as refusal:
            parts.append(f"{str(refusal)[:29]:29s}")
            continue
        there_mm = SurfaceDistance(sweep.truth)(found.surface.sample(20_000, np.random.default_rng(1)))
        back_mm = SurfaceDistance(found.surface)(sweep.truth_mm[sweep.between])
        lines = 0 if found.centerline is None else len(found.centerline.lines)
        parts.append(
            f"{(back_mm <= NEAR_MM).mean():6.1%} {there_mm.max():7.2f} {np.percentile(there_mm, 95):6.2f} "
            f"{lines:2d} {found.pieces.kept:2d}p"
        )
    rejected = set(np.flatnonzero(AFTER.mask_outliers(masks, poses).rejected).tolist())
    visible = {frame for frame, kind in wrong.items() if kind != "empty"}
    parts.append(f"{len(rejected & visible):3d} {len(rejected - visible):3d} {len(visible - rejected):3d}")
    print("  ".join(parts), flush=True)


def spoilt(masks: np.ndarray, share: float, rng: np.random.Generator) -> tuple[np.ndarray, dict[int, str]]:
    """The masks with a share of them wrong in turn by each fault, and which."""
    masks, wrong = masks.copy(), {}
    shown = rng.permutation(np.flatnonzero(masks.any(axis=(1, 2))))
    for number, frame in enumerate(shown[: round(share * len(masks))]):
        kind = FAULTS[number % len(FAULTS)]
        wrong[int(frame)] = kind
        masks[frame] = _spoilt(masks[frame], kind, rng)
    return masks, wrong


def _spoilt(mask: np.ndarray, kind: str, rng: np.random.Generator) -> np.ndarray:
    height, width = mask.shape
    row, column = np.mgrid[:height, :width]
    radius_px = max(float(np.sqrt(mask.sum() / np.pi)), 4.0)
    if kind == "empty":
        return np.zeros_like(mask)
    if kind == "full":
        return np.ones_like(mask)
    if kind == "blob":
        across, down = rng.uniform(radius_px, (width - radius_px, height - radius_px))
        return np.asarray(np.hypot(column - across, row - down) < radius_px)
    if kind == "shifted":
        angle, far_px = rng.uniform(0, 2 * np.pi), rng.uniform(1, 3) * radius_px
        move = round(far_px * np.sin(angle)), round(far_px * np.cos(angle))
        return np.roll(mask, move, axis=(0, 1))
    # Twice the area, about its middle.
    places = np.argwhere(mask).mean(axis=0)
    source = [
        np.rint(middle + (place - middle) / np.sqrt(2)).astype(int)
        for middle, place in zip(places, (row, column), strict=True)
    ]
    return mask[source[0].clip(0, height - 1), source[1].clip(0, width - 1)]


if __name__ == "__main__":
    main()
