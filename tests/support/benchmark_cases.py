"""Small benchmark cases drawn by formula: a bent tube in a known place, with no simulator behind them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation
from vessels import bent_tube

from registration import transforms
from registration.benchmark.case_files import write_case
from registration.benchmark.cases import BenchmarkCase, CaseTruth
from registration.benchmark.symmetry import Symmetry

TUBE = bent_tube()
MIDDLE_MM = TUBE.vertices_mm[:-2].reshape(80, 32, 3).mean(axis=1)


def drawn_case(
    name: str = "tube_whole",
    anatomy: str = "tube",
    kind: str = "whole",
    seed: int = 0,
    angle_deg: float = 40.0,
    symmetry: Symmetry | None = None,
) -> tuple[BenchmarkCase, CaseTruth]:
    """300 points of the tube in 30 frames along it, turned about their centroid and moved by 8 mm along x."""
    rng = np.random.default_rng(seed)
    points_mm = TUBE.sample(300, rng)
    axis = rng.normal(size=3)
    turn = Rotation.from_rotvec(np.deg2rad(angle_deg) * axis / np.linalg.norm(axis))
    moved_T_true = transforms.compose(
        transforms.translation((8.0, 0.0, 0.0)), transforms.rotate_about(turn, points_mm.mean(axis=0))
    )
    along = (points_mm - points_mm.mean(axis=0)) @ np.linalg.svd(points_mm - points_mm.mean(axis=0))[2][0]
    case = BenchmarkCase(
        name=name,
        anatomy=anatomy,
        kind=kind,
        moving_mm=transforms.apply(moved_T_true, points_mm),
        moving_normals=np.tile([0.0, 0.0, 1.0], (300, 1)),
        moving_frame=(np.argsort(np.argsort(along)) // 10).astype(np.int64),
        fixed=TUBE,
        fixed_mm=TUBE.sample(900, rng),
    )
    truth = CaseTruth(
        name=name,
        anatomy=anatomy,
        kind=kind,
        place="middle",
        fixed_T_moving=transforms.invert_rigid(moved_T_true),
        targets_mm=MIDDLE_MM,
        covered=np.arange(len(MIDDLE_MM)) < 50,
        outlier=np.zeros(300, dtype=bool),
        angle_deg=angle_deg,
        translation_mm=8.0,
        symmetry=symmetry or Symmetry(),
    )
    return case, truth


def written_cases(
    folder: Path, names: dict[str, tuple[str, str]]
) -> dict[str, tuple[BenchmarkCase, CaseTruth]]:
    """Write a case of each name (with anatomy and kind) into a subset's folder."""
    made = {}
    for seed, (name, (anatomy, kind)) in enumerate(names.items()):
        made[name] = drawn_case(name, anatomy, kind, seed)
        write_case(folder, *made[name])
    return made


def off_by(truth: CaseTruth, shift_mm: tuple[float, float, float]) -> np.ndarray:
    """A result that is wrong by a shift in the fixed frame alone: its TRE is the shift's length."""
    return transforms.compose(transforms.translation(shift_mm), truth.fixed_T_moving)
